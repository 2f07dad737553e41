"""12-bit colour in 16 bits was read almost black."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch

from steered_marigold.io.images import read_image


def test_it_is_read_as_bright_as_it_is(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).integers(0, 256, (8, 9, 3), np.uint16)
    colours[0, 0] = 255
    cv2.imwrite(str(tmp_path / "a.png"), colours[..., ::-1] * 16)
    read = read_image(tmp_path / "a.png")
    assert np.array_equal(read.pixels.numpy(), colours)
    assert read.notes[0].kind == "colour_stretched"


def test_the_case(case: Callable[[str], Path]) -> None:
    deep, plain = (
        read_image(case("colour_12bit") / name) for name in ("c_rgb12in16.png", "rgb.png")
    )
    assert torch.equal(deep.pixels, plain.pixels)
    assert deep.notes[0].kind == "colour_stretched"
    assert plain.notes == ()
