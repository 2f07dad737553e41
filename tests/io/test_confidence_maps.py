"""Confidence files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.confidence_maps import read_confidence


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_png_is_scaled_by_its_full_range(tmp_path: Path, dtype: type, white: int) -> None:
    Image.fromarray(np.array([[0, white // 5, white]], dtype)).save(tmp_path / "a.png")
    assert read_confidence(tmp_path / "a.png").tolist() == [[0, pytest.approx(0.2), 1]]


def test_floats_are_taken_as_they_are(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[[0.0, 0.25, 1.0]]]))
    assert read_confidence(tmp_path / "a.npy").tolist() == [[0, 0.25, 1]]


@pytest.mark.parametrize(
    ("array", "problem"),
    [
        (np.array([[0.0, 1.5]]), "0..1"),
        (np.array([[np.nan, 0.5]]), "0..1"),
        (np.array([[0, 1]]), "must be floats"),
        (np.zeros((4, 5, 3)), "must be floats"),
    ],
)
def test_arrays_that_are_no_confidence(tmp_path: Path, array: NDArray[Any], problem: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(FileFormatError, match=problem):
        read_confidence(tmp_path / "a.npy")


def test_files_that_are_no_confidence(tmp_path: Path) -> None:
    Image.new("RGB", (4, 5)).save(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match="must be grey"):
        read_confidence(tmp_path / "a.png")
    (tmp_path / "b.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(FileFormatError, match="damaged"):
        read_confidence(tmp_path / "b.npy")
    (tmp_path / "c.exr").write_bytes(b"")
    with pytest.raises(FileFormatError, match="unknown extension"):
        read_confidence(tmp_path / "c.exr")
    with pytest.raises(FileFormatError, match="no such file"):
        read_confidence(tmp_path / "d.npy")
