"""Numbers that are no depths."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.core.plausibility import plausible_measurements


def scene() -> torch.Tensor:
    """A room of 1 to 6 m in whole millimetres, 120x160 px."""
    y, x = torch.meshgrid(torch.arange(120), torch.arange(160), indexing="ij")
    ripple = torch.rand(120, 160, generator=torch.Generator().manual_seed(0)) * 0.02
    return ((1.0 + y / 60 + x / 55 + ripple) * 1000).round() / 1000


FILLS = (1e10, 3.4e38, 65504, 65535, 65.535, 65.534, 32.767, 10.0, 20.0, 0.001)


@pytest.mark.parametrize("fill", FILLS)
def test_a_fill_is_missing_whatever_its_value(fill: float) -> None:
    depth = scene()
    depth[30:60, 40:90] = fill
    result = plausible_measurements(depth, depth > 0)
    impossible = fill > 1e5
    assert (result.beyond_limits, result.repeated) == ((1500, 0) if impossible else (0, 1500))
    assert result.absurd == 0
    assert not bool(result.mask[30:60, 40:90].any())
    assert int(result.mask.sum()) == depth.numel() - 30 * 50
    assert result.fills == (() if impossible else pytest.approx([fill], rel=1e-6))


def test_two_fills_at_once() -> None:
    depth = scene()
    depth[30:60, 40:90], depth[80:90, 10:30] = 65.535, 1e-3
    assert plausible_measurements(depth, depth > 0).repeated == 1500 + 200


def test_single_absurd_values_are_missing() -> None:
    depth = scene()
    depth[5, 5], depth[9, 70] = 4000.0, 2e-3
    result = plausible_measurements(depth, depth > 0)
    assert (result.repeated, result.absurd) == (0, 2)
    assert not bool(result.mask[5, 5] | result.mask[9, 70])


def test_scenes_are_plausible() -> None:
    depth = scene()
    coarse = (depth / 0.0392).round() * 0.0392  # NYUv2's steps
    wall = depth.clone()
    wall[:20] = 8.0  # flat, and behind all else
    two = torch.where(torch.arange(160) < 80, 1.0, 3.0).expand(120, 160)
    outdoors = depth**3 / 3
    for values in (depth, coarse, wall, two, torch.full_like(depth, 2.0), outdoors):
        assert bool(plausible_measurements(values, values > 0).mask.all())


def test_a_handful_is_plausible() -> None:
    depth = scene()
    mask = torch.zeros_like(depth, dtype=torch.bool)
    mask[:3, :5] = True
    depth[0, 0] = 1e4
    assert torch.equal(plausible_measurements(depth, mask).mask, mask)
    nothing = torch.zeros_like(mask)
    assert torch.equal(plausible_measurements(depth, nothing).mask, nothing)


@given(st.floats(0.01, 100))
def test_another_scale_is_as_plausible(scale: float) -> None:
    depth = scene()
    depth[30:60, 40:90] = 20.0
    plain, scaled = (plausible_measurements(depth * s, depth > 0) for s in (1.0, scale))
    assert torch.equal(plain.mask, scaled.mask)


def test_a_flat_box_before_all_else_is_no_fill() -> None:
    """Rendered frames: one value at hundreds of pixels, nearer than the rest."""
    depth = torch.linspace(2.5, 3.3, 80 * 60).reshape(60, 80)
    depth[20:40, 30:60] = 1.4
    found = plausible_measurements(depth, depth > 0)
    assert (found.repeated, found.absurd) == (0, 0)


@given(st.floats(min_value=0, exclude_min=True, allow_infinity=False, width=32))
def test_what_no_depth_is_counts_as_missing(value: float) -> None:
    depth = torch.full((10, 10), 2.0)
    depth[0, :3] = value
    found = plausible_measurements(depth, depth > 0)
    if not 0.001 <= value <= 1e5:
        assert found.beyond_limits == int((depth[0, :3] > 0).sum())
        assert not found.mask[0, :3].any()
    assert bool(found.mask[1:].all())
