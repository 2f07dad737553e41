"""Fill values came back as depth with uncertainty 0: whatever the value and the type, missing."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from steered_marigold.core.frame import Frame
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame

BLOCK = 48_000
FILLS = (
    1e10,
    3.4028235e38,
    65504.0,
    65535.0,
    65.535,
    65.534,
    32.767,
    32767.0,
    10000.0,
    20.0,
    0.001,
)


def _with_block(tmp_path: Path, fill: float) -> Frame:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0:1:480j, 0:1:640j]
    depth = (1 + 3 * x + y + rng.normal(0, 0.003, x.shape)).astype(np.float32)
    depth[100:300, 100:340] = fill
    np.save(tmp_path / "depth.npy", depth)
    image = rng.integers(0, 256, (480, 640, 3), dtype=np.uint8)
    Image.fromarray(image).save(tmp_path / "image.png")
    files = FrameFiles(image=tmp_path / "image.png", depth=tmp_path / "depth.npy")
    return read_frame(files, Reading())


def _filled(frame: Frame) -> int:
    """Pixels that count as missing because one number was written over many."""
    return frame.missing["beyond_limits"] + frame.missing["repeated"] + frame.missing["absurd"]


@pytest.mark.parametrize("fill", FILLS)
def test_a_block_of_one_number_is_missing(tmp_path: Path, fill: float) -> None:
    frame = _with_block(tmp_path, fill)
    assert not frame.valid_mask[100:300, 100:340].any()
    assert int(frame.valid_mask.sum()) == 480 * 640 - BLOCK
    assert _filled(frame) == BLOCK
    if frame.missing["repeated"]:
        assert "fill" in [notice.kind for notice in frame.notices]


@pytest.mark.parametrize("name", ["fill1e10", "mask1e20", "f16max", "i32_65535", "eps0.001"])
def test_the_case(case: Callable[[str], Path], name: str) -> None:
    folder = case("sentinel_fill")
    frame = read_frame(
        FrameFiles(image=folder / "rgb.png", depth=folder / f"{name}.npy"), Reading()
    )
    assert _filled(frame) == BLOCK
