"""What is told is in the first answer's units, and the truth where it was measured."""

import pytest
import torch

from steered_marigold.core.frame import Frame, make_frame
from training.told import draw_measured, tell


def frame() -> tuple[torch.Tensor, torch.Tensor]:
    """A sloping floor with a box [m] and a first answer of it, other in scale, shift and box."""
    y, x = torch.meshgrid(torch.linspace(0, 1, 120), torch.linspace(0, 1, 160), indexing="ij")
    box = ((x - 0.5).abs() < 0.15) & ((y - 0.5).abs() < 0.2)
    depth = 4 - 2 * y - 0.8 * box
    first = (depth + 0.4 * box - 3) * 0.6
    return first, depth


def measured(depth: torch.Tensor, mask: torch.Tensor) -> Frame:
    return make_frame(torch.zeros(*depth.shape, 3), depth, mask)


def test_a_hole_is_told_in_the_units_of_the_first_answer() -> None:
    first, depth = frame()
    mask = torch.ones_like(depth, dtype=torch.bool)
    mask[30:90, 40:120] = False
    told = tell(first, depth, measured(depth, mask))
    assert told is not None
    torch.testing.assert_close(told.depth[mask], told.target[mask], atol=0.02, rtol=0)
    slope = (told.target[119, 0] - told.target[0, 0]) / (depth[119, 0] - depth[0, 0])
    assert float(slope) == pytest.approx(0.6, rel=0.1)
    assert told.known.shape == (15, 20)
    assert not told.known[5:10, 7:13].any()
    assert told.known[0].all()


def test_too_little_tells_nothing() -> None:
    first, depth = frame()
    mask = torch.zeros_like(depth, dtype=torch.bool)
    mask[0, :5] = True
    assert tell(first, depth, measured(depth, mask)) is None


def test_holes_vary_and_hide_what_is_unknown() -> None:
    _, depth = frame()
    known = torch.ones_like(depth, dtype=torch.bool)
    known[:, :30] = False
    generator = torch.Generator().manual_seed(0)
    shares = []
    for _ in range(40):
        measured = draw_measured(depth, known, generator)
        assert not (measured.valid_mask & ~known).any()
        assert (measured.sparse_depth[~measured.valid_mask] == 0).all()
        shares.append(float(measured.valid_mask.float().mean()))
    assert min(shares) < 0.05
    assert max(shares) > 0.6
