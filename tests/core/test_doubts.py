"""What is doubted, and that real frames are not."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.doubts import blank_image_doubts, require_another_image, scale_doubts
from steered_marigold.core.inversion import inversion_doubts
from steered_marigold.errors import InputError
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image

SIZE = (120, 160)


def _room() -> torch.Tensor:
    """z [m] of a floor, a ceiling and a wall, from the planes' equations."""
    y = (torch.arange(120.0)[:, None] - 59.5) / 130
    x = (torch.arange(160.0)[None, :] - 79.5) / 130
    floor = torch.where(y > 0, 1.2 / y.clamp(min=1e-6), torch.inf)
    ceiling = torch.where(y < 0, 1.4 / (-y).clamp(min=1e-6), torch.inf)
    wall = 6.0 / (1 + 0.5 * x)
    return torch.minimum(torch.minimum(floor, ceiling), wall)


@pytest.mark.parametrize(("metres", "doubted"), [(0.001, True), (0.5, False), (1500.0, True)])
def test_a_wrong_unit(metres: float, doubted: bool) -> None:
    depth = torch.tensor([[0.0, metres, metres, metres]])
    kinds = [notice.kind for notice in scale_doubts(depth, depth > 0)]
    assert kinds == (["implausible_scale"] if doubted else [])


@pytest.mark.parametrize("colour", [0, 128, 255])
def test_an_image_of_one_colour_is_doubted(colour: int) -> None:
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(*SIZE, 3, generator=generator)
    image = (colour + noise).round().clamp(0, 255).to(torch.uint8)
    (notice,) = blank_image_doubts(image)
    assert notice.kind == "blank_image"
    image[:40, :40] = 60  # a thing in a corner
    assert blank_image_doubts(image) == ()


def test_nothing_measured_is_not_suspicious() -> None:
    nothing = torch.zeros(SIZE)
    assert scale_doubts(nothing, nothing > 0) == ()
    assert inversion_doubts(nothing, nothing > 0) == ()


def test_disparity_and_inverse_depth() -> None:
    depth = _room()
    assert inversion_doubts(depth, depth > 0) == ()
    (notice,) = inversion_doubts(12 / depth, depth > 0)
    assert notice.kind == "looks_inverse"
    assert "`depth_encoding` disparity (with `baseline`) or inverse" in notice.text
    holes = torch.rand(SIZE, generator=torch.Generator().manual_seed(0)) < 0.5
    assert [n.kind for n in inversion_doubts(12 / depth, holes)] == ["looks_inverse"]


def test_real_frames_are_not_taken_for_disparity_and_most_disparity_is(nyuv2_train: Path) -> None:
    files = sorted((nyuv2_train / "depth").glob("*.png"))[::40]
    found = 0
    for file in files:
        frame = read_depth(file)
        assert inversion_doubts(frame.depth, frame.valid_mask) == (), file
        assert scale_doubts(frame.depth, frame.valid_mask) == (), file
        inverse = torch.where(frame.valid_mask, 5 / frame.depth, 0.0)
        found += len(inversion_doubts(inverse, frame.valid_mask))
    assert found > 0.7 * len(files)


def test_a_depth_map_is_not_its_own_image(tmp_path: Path) -> None:
    codes = (1000 * _room()).numpy().astype(np.uint16)
    codes[:10] = 0
    Image.fromarray(codes).save(tmp_path / "a.png")
    frame, image = read_depth(tmp_path / "a.png"), read_image(tmp_path / "a.png").pixels
    with pytest.raises(InputError, match="the image is the depth map itself"):
        require_another_image(image, frame.depth, frame.valid_mask)
    infrared = (255 - image.int()).to(torch.uint8)
    require_another_image(infrared, frame.depth, frame.valid_mask)
    colour = image.clone()
    colour[..., 0] //= 2
    require_another_image(colour, frame.depth, frame.valid_mask)
    flat = torch.ones(SIZE)
    require_another_image(torch.full((*SIZE, 3), 9, dtype=torch.uint8), flat, flat > 0)
