"""Confidence in ARKit's levels 0, 1, 2 was read as 2/255 in silence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from steered_marigold.io.confidence_maps import read_confidence


def test_levels(tmp_path: Path) -> None:
    Image.fromarray(np.array([[0, 1, 2]], np.uint8)).save(tmp_path / "c.png")
    read = read_confidence(tmp_path / "c.png")
    assert read.confidence.tolist() == [[0, 0.5, 1]]
    assert read.notes[0].kind == "confidence_levels"


def test_the_case(case: Callable[[str], Path]) -> None:
    read = read_confidence(case("arkit_conf012") / "conf012.png")
    assert bool((read.confidence == 1).all())
    assert read.notes[0].kind == "confidence_levels"
