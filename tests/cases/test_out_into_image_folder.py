"""Results beside the images broke the next run; two files of one stem are named as the reason."""

from collections.abc import Callable
from pathlib import Path

import pytest

from steered_marigold.errors import InputError
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.pairing import pair_files


def test_both_files_are_listed() -> None:
    with pytest.raises(InputError, match=r"0\.jpg, 0\.png and 0\.npy"):
        pair_files(["0.jpg", "0.png"], ["0.npy"])


def test_the_case(case: Callable[[str], Path]) -> None:
    folder = case("out_into_image_folder")
    folders = FrameFiles(image=folder / "color", depth=folder / "depth")
    expected = FrameFiles(image=folder / "color/0.jpg", depth=folder / "depth/0.png")
    assert dict(folder_source(folders, Reading()).files) == {"0": expected}
