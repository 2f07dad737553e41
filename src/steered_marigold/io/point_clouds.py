"""Coloured point clouds: binary PLY."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from steered_marigold.core.geometry import unproject
from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import (
    AnyPath,
    atomic_write,
    decoding,
    require_file,
    require_suffix,
)

_AXES = ("x", "y", "z")
_COLOURS = ("red", "green", "blue")
_VERTEX = np.dtype([(name, "<f4") for name in _AXES] + [(name, "u1") for name in _COLOURS])
_HEADER = "\n".join(
    [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres; camera frame: x right, y down, z forward",
        "element vertex {count}",
        *(f"property float {name}" for name in _AXES),
        *(f"property uchar {name}" for name in _COLOURS),
        "end_header\n",
    ]
)


@dataclass(frozen=True, kw_only=True)
class PointCloud:
    """points: [m], camera frame (x right, y down, z forward). colors: RGB in 0..255."""

    points: Float[Tensor, "points 3"]
    colors: UInt8[Tensor, "points 3"]


def point_cloud(
    depth: Float[Tensor, "height width"],
    image: UInt8[Tensor, "height width 3"],
    K: Float[Tensor, "3 3"],
) -> PointCloud:
    """One point for each pixel with depth [m] above 0, row by row. K in pixels."""
    known = depth > 0
    return PointCloud(points=unproject(depth, K)[known], colors=image[known])


def write_point_cloud(path: AnyPath, cloud: PointCloud) -> None:
    """Writes a binary little-endian .ply; InputError if `path` cannot be written."""
    require_suffix(path, (".ply",))
    vertices = np.empty(len(cloud.points), _VERTEX)
    for column, (axis, colour) in enumerate(zip(_AXES, _COLOURS, strict=True)):
        vertices[axis] = cloud.points[:, column].cpu().numpy()
        vertices[colour] = cloud.colors[:, column].cpu().numpy()
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(_HEADER.format(count=len(vertices)).encode("ascii"))
        file.write(vertices.tobytes())


def read_point_cloud(path: AnyPath) -> PointCloud:
    """Reads what write_point_cloud wrote; FileFormatError for any other file."""
    path = require_file(path)
    with decoding(path):
        header, end, body = path.read_bytes().partition(b"end_header\n")
        lines = (header + end).decode("ascii").splitlines()
        count = next((int(line.split()[2]) for line in lines if line.startswith("element ")), 0)
        if (header + end).decode("ascii") != _HEADER.format(count=count):
            raise FileFormatError(f"{path}: not a point cloud that this package wrote")
        vertices = np.frombuffer(body, _VERTEX, count=count)
    return PointCloud(
        points=torch.from_numpy(np.stack([vertices[name] for name in _AXES], axis=-1)),
        colors=torch.from_numpy(np.stack([vertices[name] for name in _COLOURS], axis=-1)),
    )
