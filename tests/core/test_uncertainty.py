"""The uncertainty of an answer: its laws, and its value written out by hand."""

import math

import pytest
import torch

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.uncertainty import UncertaintyModel, estimate_uncertainty, mean_steps

MODEL = UncertaintyModel(
    near=0.01, reach=0.8, length=0.05, extrapolation=2.0, spread=0.5, relief=6.0
)
DEPTH = torch.full((30, 40), 2.0)


def estimate(
    trusted: torch.Tensor,
    *,
    prior: torch.Tensor = DEPTH * 1.1,
    spread: torch.Tensor | None = None,
    noise: SensorNoise | None = None,
) -> torch.Tensor:
    return estimate_uncertainty(MODEL, prior, DEPTH, DEPTH, trusted, spread, noise or SensorNoise())


@pytest.fixture
def trusted() -> torch.Tensor:
    mask = torch.zeros(30, 40, dtype=torch.bool)
    mask[15, 10] = True
    return mask


def test_the_formula(trusted: torch.Tensor) -> None:
    distance = math.hypot(5, 12)
    far = 1 - math.exp(-((distance / 50 / 0.05) ** 1.5))
    disagreement = math.sqrt((math.log(1.1) ** 2 + 3 * 0.2**2) / 4)
    relative = 0.01 + 0.8 * disagreement * far
    expected = math.hypot(2 * relative, 0.3 * 0.5 * far)
    result = estimate(trusted, spread=torch.full_like(DEPTH, 0.3))
    assert result[20, 22].item() == pytest.approx(expected, rel=1e-5)


def test_a_fit_that_few_measurements_confirm_is_less_sure(trusted: torch.Tensor) -> None:
    many = torch.zeros_like(trusted)
    many[15, :10] = True
    many[15, 10] = True
    assert estimate(many, prior=DEPTH)[15, 20] < 0.7 * estimate(trusted, prior=DEPTH)[15, 20]


def test_at_a_measurement_it_is_the_sensors(trusted: torch.Tensor) -> None:
    assert estimate(trusted)[15, 10] == 0
    noisy = estimate(trusted, noise=SensorNoise(metres=0.01, fraction=0.02))
    assert noisy[15, 10].item() == pytest.approx(0.05)


def test_it_grows_with_distance_and_disagreement(trusted: torch.Tensor) -> None:
    near_prior, far_prior = estimate(trusted), estimate(trusted, prior=DEPTH * 1.5)
    assert bool((near_prior[15, 10:].diff() >= 0).all())
    assert near_prior[15, 14] > near_prior[15, 12] > near_prior[15, 11]
    assert bool((far_prior[15, 11:] > near_prior[15, 11:]).all())


def test_away_from_the_measured_depths_it_grows_faster(trusted: torch.Tensor) -> None:
    deep = DEPTH.clone()
    deep[:, 30:] = 6.0
    result = estimate_uncertainty(MODEL, deep * 1.1, deep, deep, trusted, None, SensorNoise())
    leverage = math.sqrt(1 + 2 * math.log(3) ** 2 / 0.05)
    at_depth_6, at_depth_2 = result[15, 39] / 6 - 0.01, result[15, 26] / 2 - 0.01
    assert (at_depth_6 / at_depth_2).item() == pytest.approx(leverage, rel=0.05)


def test_it_is_larger_around_depth_edges(trusted: torch.Tensor) -> None:
    edge = DEPTH.clone()
    edge[:, 30:] = 3.0
    with_edge, without = estimate(trusted, prior=edge), estimate(trusted, prior=DEPTH)
    assert (with_edge[:, 28:31] > without[:, 28:31]).all()
    torch.testing.assert_close(with_edge[:, 12:24], without[:, 12:24])


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
