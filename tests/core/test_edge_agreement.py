"""Depth edges that do not meet the image's are noticed, and real ones are not."""

from pathlib import Path

import pytest
import torch

from steered_marigold.core.edge_agreement import edge_agreement, misalignment_doubts
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image


def _boxes(shift: tuple[int, int] = (0, 0), scale: float = 1.0) -> tuple[torch.Tensor, ...]:
    """Boxes before a wall: the image, and depth that is scaled, then moved by (x, y)."""
    generator = torch.Generator().manual_seed(0)
    image = torch.full((240, 320, 3), 90, dtype=torch.uint8)
    depth = torch.full((240, 320), 4.0)
    for _ in range(14):
        top, left, high, wide = (
            int(torch.randint(a, b, (), generator=generator))
            for a, b in ((20, 190), (20, 260), (15, 45), (15, 45))
        )
        shade = int(torch.randint(120, 250, (), generator=generator))
        image[top : top + high, left : left + wide] = shade
        corners = [
            round((edge - middle) * scale + middle + move)
            for edge, middle, move in (
                (top, 120, shift[1]),
                (top + high, 120, shift[1]),
                (left, 160, shift[0]),
                (left + wide, 160, shift[0]),
            )
        ]
        depth[corners[0] : corners[1], corners[2] : corners[3]] = 1 + shade / 200
    return image, depth, depth > 0


def test_edges_that_meet_are_not_doubted() -> None:
    assert misalignment_doubts(*_boxes()) == ()
    assert misalignment_doubts(*_boxes((2, -1))) == ()


@pytest.mark.parametrize("shift", [(14, 0), (-12, 6), (0, -15)])
def test_a_shift_is_found(shift: tuple[int, int]) -> None:
    agreement = edge_agreement(*_boxes(shift))
    assert agreement is not None
    assert agreement.scale == (1, 1)
    assert abs(agreement.shift[0] + shift[0]) <= 1
    assert abs(agreement.shift[1] + shift[1]) <= 1
    (notice,) = misalignment_doubts(*_boxes(shift))
    assert notice.kind == "misaligned"
    assert "`depth_intrinsics`" in notice.text


def test_a_scale_is_found() -> None:
    agreement = edge_agreement(*_boxes(scale=1 / 0.94))
    assert agreement is not None
    assert agreement.scale == (0.94, 0.94)
    (notice,) = misalignment_doubts(*_boxes(scale=1 / 0.94))
    assert "scaled by 0.94" in notice.text


@pytest.mark.parametrize(
    ("axes", "words"),
    [((1,), "left to right"), ((0,), "upside down"), ((0, 1), "turned by 180 degrees")],
)
def test_a_mirrored_map_is_found(axes: tuple[int, ...], words: str) -> None:
    image, depth, valid = _boxes()
    (notice,) = misalignment_doubts(image, depth.flip(axes), valid.flip(axes))
    assert words in notice.text


def test_a_symmetrical_scene_is_not_doubted() -> None:
    image, depth, valid = _boxes()
    image, depth, valid = (t[:, :160] for t in (image, depth, valid))
    image, depth, valid = (torch.cat([t, t.flip(1)], dim=1) for t in (image, depth, valid))
    assert misalignment_doubts(image, depth, valid) == ()


def test_too_few_edges_tell_nothing() -> None:
    image, depth, valid = _boxes((14, 0))
    assert edge_agreement(image, torch.ones_like(depth), valid) is None
    sparse = torch.rand(240, 320, generator=torch.Generator().manual_seed(1)) < 0.02
    assert edge_agreement(image, depth, sparse) is None


def test_real_frames_are_not_doubted_and_moved_ones_are(nyuv2_train: Path) -> None:
    frames = sorted((nyuv2_train / "depth").glob("*.png"))[::80]
    found = 0
    for file in frames:
        image = read_image(nyuv2_train / "rgb" / f"{file.stem}.jpg").pixels
        frame = read_depth(file)
        assert misalignment_doubts(image, frame.depth, frame.valid_mask) == (), file
        moved, valid = (t.roll((8, 24), (0, 1)) for t in (frame.depth, frame.valid_mask))
        found += len(misalignment_doubts(image, moved, valid))
    assert found >= 0.5 * len(frames)
