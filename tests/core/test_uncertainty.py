"""The uncertainty of an answer: its laws, and its value written out by hand."""

import math

import pytest
import torch

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.holes import find_holes
from steered_marigold.core.uncertainty import (
    DEFAULT_NOISE,
    UncertaintyModel,
    estimate_uncertainty,
    mean_steps,
)

MODEL = UncertaintyModel(
    near=0.01, reach=0.8, drift=0.3, length=0.05, origin=0.5, moved=0.4, farther=2.0,
    nearer=1.0, relief=6.0, by_kind=(1.0, 1.5, 2.0, 3.0),
)  # fmt: skip
DEPTH = torch.full((30, 40), 2.0)


def estimate(
    trusted: torch.Tensor,
    *,
    prior: torch.Tensor = DEPTH * 1.1,
    depth: torch.Tensor = DEPTH,
    doubt: torch.Tensor | None = None,
    noise: SensorNoise = DEFAULT_NOISE,
) -> torch.Tensor:
    holes = find_holes(depth, DEPTH, trusted)
    return estimate_uncertainty(MODEL, prior, depth, DEPTH, trusted, holes, doubt, noise)


@pytest.fixture
def trusted() -> torch.Tensor:
    mask = torch.zeros(30, 40, dtype=torch.bool)
    mask[15, 10] = True
    return mask


def test_the_formula(trusted: torch.Tensor) -> None:
    far = 1 - math.exp(-((math.hypot(5, 12) / 50 / 0.05) ** 1.5))
    disagreement = math.sqrt((math.log(1.1) ** 2 + 3 * 0.2**2) / 4)
    terms = (0.8 * disagreement, 0.3 * 13 / 50, 0.5 * 0.3, 0.4 * math.log(1.1))
    relative = 1.5 * math.sqrt(0.01**2 + far * sum(term**2 for term in terms))
    result = estimate(trusted, doubt=torch.full_like(DEPTH, 0.3))
    assert result[20, 22].item() == pytest.approx(2 * math.hypot(relative, 0.002), rel=1e-5)


def test_beyond_the_measured_range(trusted: torch.Tensor) -> None:
    for ratio, factor, kind in ((2.0, 2.0, 2), (0.5, 1.0, 3)):
        result = estimate(trusted, prior=DEPTH * ratio, depth=DEPTH * ratio)
        disagreement = math.sqrt((math.log(2) ** 2 + 3 * 0.2**2) / 4)
        terms = (0.8 * disagreement, 0.3 * math.hypot(14, 29) / 50, factor * math.log(2))
        relative = MODEL.by_kind[kind] * math.sqrt(0.01**2 + sum(term**2 for term in terms))
        expected = 2 * ratio * math.hypot(relative, 0.002)
        assert result[29, 39].item() == pytest.approx(expected, rel=1e-3)


def test_between_measurements_it_is_surer_than_beside_them() -> None:
    left = torch.zeros(30, 40, dtype=torch.bool)
    left[:, :5] = True
    both = left.clone()
    both[:, 35:] = True
    beside, inside = (estimate(trusted)[15, 10] for trusted in (left, both))
    assert float(beside / inside) == pytest.approx(1.5, rel=0.03)


def test_a_fit_that_few_measurements_confirm_is_less_sure(trusted: torch.Tensor) -> None:
    many = torch.zeros_like(trusted)
    many[15, :11] = True
    assert estimate(many, prior=DEPTH)[15, 20] < 0.7 * estimate(trusted, prior=DEPTH)[15, 20]


def test_at_a_measurement_it_is_the_sensors_and_never_0(trusted: torch.Tensor) -> None:
    assert estimate(trusted)[15, 10].item() == pytest.approx(0.002 * 2)
    noisy = estimate(trusted, noise=SensorNoise(metres=0.01, fraction=0.02))
    assert noisy[15, 10].item() == pytest.approx(0.05)


def test_it_grows_with_distance_and_disagreement(trusted: torch.Tensor) -> None:
    near_prior, far_prior = estimate(trusted), estimate(trusted, prior=DEPTH * 1.5)
    assert bool((near_prior[15, 10:].diff() >= -1e-6).all())
    assert near_prior[15, 14] > near_prior[15, 12] > near_prior[15, 11]
    assert bool((far_prior[15, 11:] > near_prior[15, 11:]).all())


def test_it_is_larger_around_depth_edges(trusted: torch.Tensor) -> None:
    edge = DEPTH.clone()
    edge[:, 30:] = 3.0
    with_edge = estimate(trusted, prior=edge, depth=edge)
    without = estimate(trusted, prior=DEPTH)
    assert bool((with_edge[:, 28:30] > without[:, 28:30]).all())
    assert bool((with_edge[:, 30:] > 1.5 * without[:, 30:]).all())


def test_mean_steps_against_a_loop() -> None:
    values = torch.rand(7, 9, generator=torch.Generator().manual_seed(0))
    steps = torch.zeros_like(values)
    steps[:, :-1] += (values[:, 1:] - values[:, :-1]).abs()
    steps[:-1] += (values[1:] - values[:-1]).abs()
    expected = torch.empty_like(values)
    for y in range(7):
        for x in range(9):
            window = steps[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
            expected[y, x] = window.mean()
    torch.testing.assert_close(mean_steps(values, radius=2), expected)
