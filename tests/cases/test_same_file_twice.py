"""A depth map given as its own image."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from steered_marigold.core.doubts import require_another_image
from steered_marigold.errors import InputError
from steered_marigold.io.depth_files import require_other_file
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image


def test_the_same_file_or_folder(tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "a.heic"):
        (tmp_path / name).touch()
    (tmp_path / "link.png").symlink_to(tmp_path / "a.png")
    require_other_file(tmp_path / "a.png", tmp_path / "b.png")
    require_other_file(tmp_path / "a.heic", tmp_path / "a.heic")  # holds an image and depth
    require_other_file(tmp_path / "nothing.png", tmp_path / "nothing.png")  # told elsewhere
    for image, depth in (("a.png", "a.png"), ("a.png", "link.png"), (".", ".")):
        with pytest.raises(InputError, match="as the image and as its depth map"):
            require_other_file(tmp_path / image, tmp_path / depth)


def test_a_copy(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(500, 9000, (20, 30), np.uint16)
    codes[:3] = 0
    Image.fromarray(codes).save(tmp_path / "a.png")
    depth = read_depth(tmp_path / "a.png")
    with pytest.raises(InputError, match="the image is the depth map itself"):
        require_another_image(read_image(tmp_path / "a.png").pixels, depth.depth, depth.valid_mask)


def test_the_case(case: Callable[[str], Path]) -> None:
    path = case("same_file_twice") / "hole.png"
    with pytest.raises(InputError):
        require_other_file(path, path)
    depth = read_depth(path)
    with pytest.raises(InputError):
        require_another_image(read_image(path).pixels, depth.depth, depth.valid_mask)
    other = read_image(case("colour_12bit") / "rgb.png").pixels
    require_another_image(other, depth.depth, depth.valid_mask)
