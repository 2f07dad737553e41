"""Coloured point clouds in binary PLY."""

from pathlib import Path

import numpy as np
import pytest
import torch

from steered_marigold.errors import FileFormatError
from steered_marigold.io.point_clouds import (
    PointCloud,
    point_cloud,
    read_point_cloud,
    write_point_cloud,
)

K = torch.tensor([[100.0, 0, 4], [0, 120, 3], [0, 0, 1]])


def _cloud(count: int) -> PointCloud:
    generator = torch.Generator().manual_seed(0)
    return PointCloud(
        points=torch.randn(count, 3, generator=generator),
        colors=torch.randint(0, 256, (count, 3), generator=generator, dtype=torch.uint8),
    )


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_write_then_read(tmp_path: Path, count: int) -> None:
    cloud = _cloud(count)
    write_point_cloud(tmp_path / "a.ply", cloud)
    back = read_point_cloud(tmp_path / "a.ply")
    assert torch.equal(back.points, cloud.points)
    assert torch.equal(back.colors, cloud.colors)


def test_the_layout_is_the_standard_one(tmp_path: Path) -> None:
    write_point_cloud(tmp_path / "a.ply", _cloud(2))
    header, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")
    assert b"element vertex 2\nproperty float x\n" in header
    assert len(body) == 2 * (3 * 4 + 3)
    assert np.frombuffer(body[:12], "<f4") == pytest.approx(_cloud(2).points[0].numpy())
    assert list(body[12:15]) == _cloud(2).colors[0].tolist()


def test_points_are_in_the_camera_frame_and_holes_are_left_out() -> None:
    depth = torch.full((7, 9), 2.0)
    depth[0] = 0
    image = torch.zeros(7, 9, 3, dtype=torch.uint8)
    image[3, 5] = torch.tensor([9, 8, 7])
    cloud = point_cloud(depth, image, K)
    assert len(cloud.points) == 6 * 9
    coloured = cloud.points[cloud.colors[:, 0] == 9]
    # one pixel right of the principal point: x = z / fx
    assert coloured.tolist() == [[pytest.approx(0.02), 0, 2]]


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    with pytest.raises(FileFormatError, match="no such file"):
        read_point_cloud(path)
    path.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")
    with pytest.raises(FileFormatError, match="not a point cloud"):
        read_point_cloud(path)
    write_point_cloud(path, _cloud(10))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(FileFormatError, match="damaged"):
        read_point_cloud(path)
    with pytest.raises(FileFormatError, match=r"use one of \.ply"):
        write_point_cloud(tmp_path / "a.xyz", _cloud(1))
