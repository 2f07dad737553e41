"""Poses in each form."""

import json
from pathlib import Path

import pytest
import torch
from scipy.spatial.transform import Rotation

from steered_marigold.errors import FileFormatError
from steered_marigold.io.extrinsics import read_extrinsics

TURN = Rotation.from_euler("xyz", [0.1, -0.2, 0.3])
MATRIX = torch.eye(4, dtype=torch.float64)
MATRIX[:3, :3] = torch.from_numpy(TURN.as_matrix())
MATRIX[:3, 3] = torch.tensor([0.015, -0.002, 0.001])


def _text(rows: int) -> str:
    return "\n".join(" ".join(map(repr, row)) for row in MATRIX[:rows].tolist())


@pytest.mark.parametrize(
    "text",
    [
        _text(4),
        "# depth to colour\n" + _text(3),
        " ".join(map(str, (0.015, -0.002, 0.001, *TURN.as_quat()))),
        json.dumps(
            {"rotation": TURN.as_matrix().T.flatten().tolist(),
             "translation": [0.015, -0.002, 0.001]}
        ),
    ],
)  # fmt: skip
def test_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "E.txt").write_text(text)
    torch.testing.assert_close(read_extrinsics(tmp_path / "E.txt"), MATRIX.float())


def test_a_translation_alone() -> None:
    expected = torch.eye(4)
    expected[0, 3] = -0.025
    assert torch.equal(read_extrinsics("-0.025,0,0"), expected)


@pytest.mark.parametrize("text", ["1 2", "", "{}", '{"rotation": 1, "translation": 2}', "x"])
def test_anything_else(tmp_path: Path, text: str) -> None:
    (tmp_path / "E.txt").write_text(text)
    with pytest.raises(FileFormatError, match=r"E\.txt: extrinsics are"):
        read_extrinsics(tmp_path / "E.txt")


@pytest.mark.parametrize("text", ["1e39 0 0", "0 0 0 0 0 0 0"])
def test_numbers_that_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "E.txt").write_text(text)
    with pytest.raises(FileFormatError, match=r"E\.txt: a number is not finite"):
        read_extrinsics(tmp_path / "E.txt")
