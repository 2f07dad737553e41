"""Camera files of seven forms were refused without a reason; each is read now.

The forms, written out, are in tests/io/test_intrinsics.py.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from steered_marigold.io.intrinsics import read_intrinsics


@pytest.mark.parametrize(
    "name", ["colmap.txt", "k_comment.txt", "k_wh.txt", "o3d.json", "ros_ci.yaml", "scannet.txt"]
)
def test_the_case(case: Callable[[str], Path], name: str) -> None:
    camera = read_intrinsics(case("intrinsics_files") / name)
    half = 0.5 if name == "colmap.txt" else 0.0  # COLMAP counts from the image's corner
    expected = [[460, 0, 320 - half], [0, 460, 240 - half], [0, 0, 1]]
    assert camera.K.tolist() == expected
    assert camera.size in (None, (480, 640))
    assert camera.for_image((480, 640))[0].tolist() == expected


def test_kitti(case: Callable[[str], Path]) -> None:
    K = read_intrinsics(case("intrinsics_files") / "kitti_calib.txt").K
    assert K.flatten().tolist() == pytest.approx([721.5, 0, 609.5, 0, 721.5, 172.8, 0, 0, 1])
