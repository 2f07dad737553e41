"""Holes that a sensor's range explains, and what is expected in them."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.core.holes import (
    BECAUSE_OF_RANGE,
    PRIOR_ERROR,
    Hole,
    Holes,
    expect_beyond,
    find_holes,
)

SHAPE = 48, 64


def ramp() -> torch.Tensor:
    """Depth from 1 m at the left to 6 m at the right."""
    return torch.linspace(1, 6, SHAPE[1]).expand(SHAPE).clone()


def holes_of(shown: torch.Tensor, prior: torch.Tensor) -> Holes:
    return find_holes(prior, ramp(), shown)


def test_depth_cut_by_distance_is_told_from_depth_cut_elsewhere() -> None:
    depth = ramp()
    upper = torch.zeros(SHAPE, dtype=torch.bool)
    upper[:24] = True
    cases = ((depth < 3, Hole.FARTHER), (depth > 3, Hole.NEARER), (upper, Hole.BESIDE))
    for shown, expected in cases:
        assert set(holes_of(shown, depth).kind[~shown].tolist()) == {int(expected)}


def test_samples_everywhere_have_no_range() -> None:
    shown = torch.zeros(SHAPE, dtype=torch.bool)
    shown[::4, ::4] = True
    assert set(holes_of(shown, ramp()).kind[4:44, 4:60].flatten().tolist()) == {int(Hole.INSIDE)}


@pytest.mark.parametrize("far", [True, False])
def test_expected_depth_against_sampling(far: bool) -> None:
    """Bayes' rule and the truncated normal distribution, by drawing from both."""
    shown = ramp() < 3 if far else ramp() > 3
    prior = ramp()
    holes = holes_of(shown, prior)
    expected = expect_beyond(prior, holes)
    generator = torch.Generator().manual_seed(0)
    y, x = 20, int((~shown[0]).nonzero()[1 if far else -2])
    log_prior = float(prior[y, x].log())
    drawn = log_prior + PRIOR_ERROR * torch.randn(400_000, generator=generator)
    beyond = drawn > holes.high if far else drawn < holes.low
    tail = float(beyond.float().mean())
    reason = BECAUSE_OF_RANGE * tail / (BECAUSE_OF_RANGE * tail + 1 - BECAUSE_OF_RANGE)
    mean = reason * float(drawn[beyond].mean()) + (1 - reason) * log_prior
    assert float(expected[y, x].log()) == pytest.approx(mean, abs=2e-3)
    torch.testing.assert_close(expected[shown], prior[shown], rtol=0, atol=0)


def test_a_prior_clearly_within_the_range_stays() -> None:
    prior = ramp()
    shown = prior < 3
    prior[20:22, 60:] = 1.2  # something near that was not measured
    expected = expect_beyond(prior, holes_of(shown, prior))
    torch.testing.assert_close(expected[20:22, 60:], prior[20:22, 60:])
    assert bool((expected[~shown] >= prior[~shown]).all())


def test_a_flat_wall_half_seen_stays() -> None:
    shown = torch.zeros(SHAPE, dtype=torch.bool)
    shown[:, :20] = True
    wall = torch.full(SHAPE, 2.0)
    prior = wall * torch.linspace(1, 1.04, SHAPE[1])
    expected = expect_beyond(prior, find_holes(prior, wall, shown))
    torch.testing.assert_close(expected, prior)


@given(st.floats(0.1, 10))
def test_scaling_the_scene_scales_what_is_expected(scale: float) -> None:
    depth, shown = ramp(), ramp() < 3
    one = expect_beyond(depth, find_holes(depth, depth, shown))
    scaled = expect_beyond(depth * scale, find_holes(depth * scale, depth * scale, shown))
    torch.testing.assert_close(scaled, one * scale, rtol=1e-4, atol=0)
