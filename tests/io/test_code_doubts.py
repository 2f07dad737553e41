"""Codes whose bits are out of order are noticed, and others are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.io.code_doubts import code_doubts
from steered_marigold.io.depth_maps import read_depth


def _slope() -> NDArray[np.uint16]:
    """A floor and a box before it, with holes [mm]."""
    rows = np.arange(120)[:, None]
    codes = np.broadcast_to(900 + 21 * (120 - rows), (120, 160)).copy()
    codes[40:80, 50:90] = 1111
    codes[np.random.default_rng(0).random(codes.shape) < 0.2] = 0
    return codes.astype(np.uint16)


def _kinds(codes: NDArray[Any]) -> list[str]:
    return [notice.kind for notice in code_doubts(codes)]


def test_order_of_bytes_and_bits() -> None:
    codes = _slope()
    assert _kinds(codes) == []
    assert _kinds(codes.byteswap()) == ["byte_swapped"]
    assert _kinds(codes << 3 | codes >> 13) == ["bit_rotated"]
    assert code_doubts(codes.astype(np.int32)) == ()
    assert code_doubts(np.zeros((100, 100), np.uint16)) == ()


def test_a_file_says_so_and_is_read_as_it_is(tmp_path: Path) -> None:
    codes = _slope().byteswap()
    Image.fromarray(codes).save(tmp_path / "a.png")
    back = read_depth(tmp_path / "a.png")
    assert "byte-swapped" in back.notes[0].text
    assert float(back.depth.max()) == pytest.approx(codes[codes < 65535].max() / 1000)
    rotated = _slope() << 3
    Image.fromarray(rotated).save(tmp_path / "a.png")
    assert "`depth_encoding` sunrgbd" in read_depth(tmp_path / "a.png").notes[0].text
    assert read_depth(tmp_path / "a.png", depth_encoding="sunrgbd").notes == ()


def test_real_frames_are_in_order_and_noticed_when_swapped(real_frames: Path) -> None:
    for file in sorted(real_frames.glob("*/depth.png")):
        codes = np.asarray(Image.open(file)).astype(np.uint16)
        assert _kinds(codes) == [], file
        assert _kinds(codes.byteswap()) == ["byte_swapped"], file
