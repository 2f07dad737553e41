"""Fill values came back as depth with uncertainty 0: beyond 100 km missing, within it doubted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from steered_marigold.core.doubts import scale_doubts
from steered_marigold.io.depth_maps import DepthMap, read_depth

BLOCK = 48_000


def _with_block(tmp_path: Path, fill: float) -> DepthMap:
    depth = np.random.default_rng(0).uniform(1, 5, (480, 640)).astype(np.float32)
    depth[100:300, 100:340] = fill
    np.save(tmp_path / "a.npy", depth)
    return read_depth(tmp_path / "a.npy")


@pytest.mark.parametrize("fill", [1e10, 1e20, 3e38])
def test_no_depth_is_beyond_100_km(tmp_path: Path, fill: float) -> None:
    read = _with_block(tmp_path, fill)
    assert read.missing["beyond_limits"] == BLOCK
    assert int((~read.valid_mask).sum()) == BLOCK


@pytest.mark.parametrize("fill", [65.535, 1000.0, 65504.0])
def test_a_block_at_the_end_of_the_range_is_doubted(tmp_path: Path, fill: float) -> None:
    read = _with_block(tmp_path, fill)
    notices = scale_doubts(read.depth, read.valid_mask)
    assert [notice.kind for notice in notices] == ["second_mode"]
    assert str(BLOCK) in notices[0].text


@pytest.mark.parametrize("name", ["fill1e10", "mask1e20", "f16max", "i32_65535"])
def test_the_case(case: Callable[[str], Path], name: str) -> None:
    read = read_depth(case("sentinel_fill") / f"{name}.npy")
    kinds = [notice.kind for notice in scale_doubts(read.depth, read.valid_mask)]
    assert read.missing["beyond_limits"] == BLOCK or kinds == ["second_mode"]
