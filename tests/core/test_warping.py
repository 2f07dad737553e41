"""Laws of what moves from one frame into the next."""

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from steered_marigold.core.warping import warp_by_flow, warp_depth

K = torch.tensor([[20.0, 0, 7.5], [0, 20.0, 5.5], [0, 0, 1]])
seeds = st.integers(0, 1000)


def _slope(seed: int, height: int = 12, width: int = 16) -> tuple[Tensor, Tensor]:
    """A rough wall without steps, so that nothing hides anything, and a mask."""
    generator = torch.Generator().manual_seed(seed)
    depth = 2 + 0.05 * torch.rand(height, width, generator=generator)
    mask = torch.rand(height, width, generator=generator) < 0.8
    return torch.where(mask, depth, 0.0), mask


@given(seeds)
def test_a_camera_that_stands_still_sees_the_same(seed: int) -> None:
    depth, mask = _slope(seed)
    warped = warp_depth(depth, mask, K, torch.eye(4))
    assert torch.equal(warped.valid_mask, mask)
    assert torch.allclose(warped.depth, depth)
    assert torch.equal(warped.carry(depth), depth)


@given(seeds, st.integers(-3, 3), st.integers(-3, 3))
def test_a_step_along_a_wall_is_a_flow_of_the_same_pixels(seed: int, dx: int, dy: int) -> None:
    """A flat wall moves as a whole, and all of it that stays in view is seen."""
    _, mask = _slope(seed)
    depth = torch.where(mask, 2.0, 0.0)
    motion = torch.eye(4)
    motion[:2, 3] = torch.tensor([dx, dy]) * 2.0 / 20
    flow = torch.tensor([float(dx), float(dy)]).expand(12, 16, 2)
    by_motion, by_flow = warp_depth(depth, mask, K, motion), warp_by_flow(depth, mask, flow)
    assert torch.equal(by_motion.valid_mask, by_flow.valid_mask)
    assert torch.allclose(by_motion.depth, by_flow.depth)


@given(seeds, st.integers(-3, 3), st.integers(-3, 3))
def test_flow_of_whole_pixels_moves_pixels(seed: int, dx: int, dy: int) -> None:
    depth, mask = _slope(seed)
    warped = warp_by_flow(depth, mask, torch.tensor([float(dx), float(dy)]).expand(12, 16, 2))
    padded = torch.nn.functional.pad(depth, (3, 3, 3, 3))
    expected = padded[3 - dy : 15 - dy, 3 - dx : 19 - dx]
    assert torch.equal(warped.depth, expected)
    assert torch.equal(warped.valid_mask, expected > 0)


def test_the_nearer_of_two_that_meet_is_seen() -> None:
    depth = torch.full((3, 5), 4.0)
    depth[:, 2] = 2.0
    flow = torch.zeros(3, 5, 2)
    flow[:, 2, 0] = 1.0
    warped = warp_by_flow(depth, torch.ones(3, 5, dtype=torch.bool), flow)
    assert warped.depth[1].tolist() == [4, 4, 0, 2, 4]


def test_flow_that_is_no_number_moves_nothing() -> None:
    depth, mask = _slope(0)
    assert not warp_by_flow(depth, mask, torch.full((12, 16, 2), torch.nan)).valid_mask.any()
