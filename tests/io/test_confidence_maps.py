"""Confidence files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.confidence_maps import ConfidenceMap, read_confidence


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_png_is_scaled_by_its_full_range(tmp_path: Path, dtype: type, white: int) -> None:
    Image.fromarray(np.array([[0, white // 5, white]], dtype)).save(tmp_path / "a.png")
    assert read_confidence(tmp_path / "a.png").confidence.tolist() == [[0, pytest.approx(0.2), 1]]


def test_floats_are_taken_as_they_are(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[[0.0, 0.25, 1.0]]]))
    assert read_confidence(tmp_path / "a.npy").confidence.tolist() == [[0, 0.25, 1]]


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_levels_of_phones_are_weights(tmp_path: Path, suffix: str) -> None:
    def read(levels: list[int]) -> ConfidenceMap:
        array = np.array([levels], np.uint8)
        path = tmp_path / f"a{suffix}"
        Image.fromarray(array).save(path) if suffix == ".png" else np.save(path, array)
        return read_confidence(path)

    levels = read([0, 1, 2, 2])
    assert levels.confidence.tolist() == [[0, 0.5, 1, 1]]
    assert [note.kind for note in levels.notes] == ["confidence_levels"]
    assert read([2, 2]).confidence.tolist() == [[1, 1]]
    mask = read([0, 1, 1])
    assert mask.confidence.tolist() == [[0, 1, 1]]
    assert "only 0 and 1" in mask.notes[0].text


def test_a_map_that_never_comes_near_white_is_doubted(tmp_path: Path) -> None:
    Image.fromarray(np.array([[0, 50, 100]], np.uint8)).save(tmp_path / "a.png")
    doubtful = read_confidence(tmp_path / "a.png")
    assert [note.kind for note in doubtful.notes] == ["confidence_low"]
    assert doubtful.confidence.max() == pytest.approx(100 / 255)
    Image.fromarray(np.array([[0, 50, 200]], np.uint8)).save(tmp_path / "a.png")
    assert read_confidence(tmp_path / "a.png").notes == ()


@pytest.mark.parametrize(
    ("array", "problem"),
    [
        (np.array([[0.0, 1.5]]), "0..1"),
        (np.array([[np.nan, 0.5]]), "0..1"),
        (np.array([[0, 3]]), "must be floats"),
        (np.array([[-1, 1]]), "must be floats"),
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
