"""Files named by time never paired, and nothing told of an association file."""

from collections.abc import Callable
from pathlib import Path

import pytest

from steered_marigold.errors import InputError
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.pairing import pair_files


def test_within_the_slop_and_beyond() -> None:
    images, depths = ["1305031229.528748.png"], ["1305031229.528784.png"]
    pairing = pair_files(images, depths)
    assert pairing.pairs == {images[0]: depths[0]}
    assert pairing.rule == "time stamps within 0.02 s"
    with pytest.raises(InputError, match="larger `slop`, or `associations`"):
        pair_files(images, depths, slop=0.00001)


def test_the_case(case: Callable[[str], Path]) -> None:
    folder = case("tum_names")
    source = folder_source(FrameFiles(image=folder / "rgb", depth=folder / "depth"), Reading())
    assert list(source.files) == ["1305031229.528748"]
    assert "time stamps" in source.rule
