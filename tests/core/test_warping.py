"""Warping against points moved one by one, and laws of what a z-buffer may do."""

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from steered_marigold.core.warping import warp_by_flow, warp_depth

K = torch.tensor([[20.0, 0, 7.5], [0, 20.0, 5.5], [0, 0, 1]])
seeds = st.integers(0, 1000)


def _depth(seed: int, height: int = 12, width: int = 16) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    depth = 1 + 4 * torch.rand(height, width, generator=generator)
    mask = torch.rand(height, width, generator=generator) < 0.8
    return torch.where(mask, depth, 0.0), mask


def _motion(seed: int) -> Tensor:
    """A turn of some degrees about an axis, and a step of some centimetres."""
    generator = torch.Generator().manual_seed(seed)
    x, y, z = (0.2 * (torch.rand(3, generator=generator) - 0.5)).tolist()
    turn = torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    motion = torch.eye(4)
    motion[:3, :3] = turn
    motion[:3, 3] = 0.2 * (torch.rand(3, generator=generator) - 0.5)
    return motion


@given(seeds)
def test_a_camera_that_stands_still_sees_the_same(seed: int) -> None:
    depth, mask = _depth(seed)
    depth = torch.where(mask, 2 + 0.01 * depth, 0.0)  # no steps, so that nothing is seen through
    warped = warp_depth(depth, mask, K, torch.eye(4))
    assert torch.equal(warped.valid_mask, mask)
    assert torch.allclose(warped.depth, depth)
    assert torch.equal(warped.carry(depth), depth)


def _points_one_by_one(depth: Tensor, mask: Tensor, motion: Tensor) -> Tensor:
    """The smallest depth that lands on each pixel, infinity where none does; a loop over pixels."""
    height, width = depth.shape
    nearest = torch.full((height, width), torch.inf)
    for v, u in mask.nonzero().tolist():
        point = torch.linalg.inv(K) @ torch.tensor([u, v, 1.0]) * depth[v, u]
        moved = motion @ torch.cat((point, torch.ones(1)))
        if moved[2] <= 0:
            continue
        x, y, _ = (K @ moved[:3] / moved[2]).tolist()
        column, row = round(x), round(y)
        if 0 <= row < height and 0 <= column < width:
            nearest[row, column] = min(nearest[row, column], moved[2])
    return nearest


@given(seeds, seeds)
def test_points_land_where_the_camera_sees_them(seed: int, motion_seed: int) -> None:
    """All that is kept is the nearest that lands there, and all that is not lies behind."""
    (depth, mask), motion = _depth(seed), _motion(motion_seed)
    warped = warp_depth(depth, mask, K, motion)
    expected = _points_one_by_one(depth, mask, motion)
    kept = warped.valid_mask
    assert torch.allclose(warped.depth[kept], expected[kept], rtol=1e-4)
    assert (warped.depth[~kept] == 0).all()
    padded = torch.nn.functional.pad(expected[None, None], (1, 1, 1, 1), value=torch.inf)
    around = -torch.nn.functional.max_pool2d(-padded, 3, stride=1)[0, 0]
    visible = expected.isfinite() & (expected <= 1.05 * around)
    # a rounding of the pixel may differ between the two ways
    assert (visible != kept).float().mean() < 0.03


def test_the_far_wall_does_not_show_through_a_near_surface() -> None:
    """Coming nearer spreads a surface's pixels, and leaves cracks that show nothing."""
    depth = torch.full((40, 40), 4.0)
    depth[10:30, 10:30] = 2.0
    intrinsics = torch.tensor([[40.0, 0, 19.5], [0, 40.0, 19.5], [0, 0, 1]])
    motion = torch.eye(4)
    motion[2, 3] = -0.7
    warped = warp_depth(depth, torch.ones(40, 40, dtype=torch.bool), intrinsics, motion)
    inner = warped.depth[8:32, 8:32]
    assert torch.allclose(inner[inner > 0], torch.tensor(1.3))
    assert (inner == 0).any()


@given(seeds, st.integers(-3, 3), st.integers(-3, 3))
def test_flow_of_whole_pixels_moves_pixels(seed: int, dx: int, dy: int) -> None:
    depth, mask = _depth(seed)
    depth = torch.where(mask, 2 + 0.01 * depth, 0.0)
    flow = torch.tensor([float(dx), float(dy)]).expand(12, 16, 2)
    warped = warp_by_flow(depth, mask, flow)
    padded = torch.nn.functional.pad(depth, (3, 3, 3, 3))
    expected = padded[3 - dy : 15 - dy, 3 - dx : 19 - dx]
    assert torch.equal(warped.depth, expected)
    assert torch.equal(warped.valid_mask, expected > 0)


def test_flow_that_is_no_number_moves_nothing() -> None:
    depth, mask = _depth(0)
    flow = torch.full((12, 16, 2), torch.nan)
    assert not warp_by_flow(depth, mask, flow).valid_mask.any()
