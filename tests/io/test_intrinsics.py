"""K from text."""

from pathlib import Path

import pytest

from steered_marigold.errors import FileFormatError
from steered_marigold.io.intrinsics import read_intrinsics

EXPECTED = [[460.5, 0, 319.5], [0, 461.25, 239.5], [0, 0, 1]]


def test_four_numbers() -> None:
    assert read_intrinsics("460.5,461.25,319.5,239.5").tolist() == EXPECTED
    assert read_intrinsics(" 460.5, 461.25, 319.5, 239.5 ").tolist() == EXPECTED


@pytest.mark.parametrize(
    "text",
    [
        "460.5 0.0 319.5\n0.0 461.25 239.5\n0.0 0.0 1.0",
        "4.605e2\t0 319.5\r\n0 461.25 239.5\r\n0 0 1\r\n\r\n",
        "[[460.5, 0, 319.5], [0, 461.25, 239.5], [0, 0, 1]]",
        "460.5,0,319.5;0,461.25,239.5;0,0,1",
        "460.5 461.25 319.5 239.5\n",
    ],
)
def test_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    assert read_intrinsics(tmp_path / "K.txt").tolist() == EXPECTED


@pytest.mark.parametrize(
    "text",
    ["", "1 2 3", "fx 460", "460 0 320 0 460 240 0 0 2", "0 460 320 240", "nan 460 320 240"],
)
def test_files_that_are_no_camera(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    with pytest.raises(FileFormatError, match=r"K\.txt"):
        read_intrinsics(tmp_path / "K.txt")


def test_arguments_that_are_no_camera(tmp_path: Path) -> None:
    for text in ("460,460,320", "-460,460,320,240"):
        with pytest.raises(FileFormatError, match=text):
            read_intrinsics(text)
    with pytest.raises(FileFormatError, match="no such file"):
        read_intrinsics(tmp_path / "K.txt")
    (tmp_path / "K.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="damaged"):
        read_intrinsics(tmp_path / "K.txt")


def test_real_frames(real_frames: Path) -> None:
    files = sorted(real_frames.glob("*/intrinsics.txt"))
    assert files
    for file in files:
        K = read_intrinsics(file)
        assert 300 < float(K[0, 0]) < 700
        assert 200 < float(K[1, 2]) < 300
