"""Triangle meshes and the few primitives that every object of a room is made of.

World and object frames: x and y horizontal, z up, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float, Float32, Int

from rooms.vectors import cross, unit

Point = Sequence[float] | Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Mesh:
    """Triangles.

    corners: [m]. normals: unit, per corner, either side. uv: texture coordinates per corner [m],
    or tiles for pictures. facet: triangles of equal facet form one smooth surface.
    """

    corners: Float32[np.ndarray, "n 3 3"]
    normals: Float32[np.ndarray, "n 3 3"]
    uv: Float32[np.ndarray, "n 3 2"]
    facet: Int[np.ndarray, " n"]

    def moved(self, position: Point, yaw: float = 0.0) -> "Mesh":
        """Turned about z by `yaw` [rad], then shifted by `position` [m]."""
        c, s = np.cos(yaw), np.sin(yaw)
        return self.turned(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])).shifted(position)

    def turned(self, rotation: Float[np.ndarray, "3 3"]) -> "Mesh":
        """Each point p becomes rotation @ p."""
        transposed = rotation.T.astype(np.float32)
        corners = (self.corners.reshape(-1, 3) @ transposed).reshape(self.corners.shape)
        normals = (self.normals.reshape(-1, 3) @ transposed).reshape(self.normals.shape)
        return Mesh(corners, normals, self.uv, self.facet)

    def shifted(self, position: Point) -> "Mesh":
        """Shifted by `position` [m]."""
        offset = np.asarray(position, dtype=np.float32)
        return Mesh(self.corners + offset, self.normals, self.uv, self.facet)

    def scaled(self, size: Point) -> "Mesh":
        """Stretched along the axes."""
        factor = np.asarray(size, dtype=np.float32)
        mean = float(factor.mean())
        return Mesh(self.corners * factor, unit(self.normals / factor), self.uv * mean, self.facet)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several; facets stay distinct."""
    counts = np.cumsum([0] + [int(mesh.facet.max()) + 1 for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.corners for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([mesh.facet + start for mesh, start in zip(meshes, counts, strict=True)]),
    )


@cache
def _cube() -> tuple[Float32[np.ndarray, "12 3 3"], Float32[np.ndarray, "12 3 3"]]:
    """Corners of the unit cube in 0..1 and their normals; two triangles a face."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], dtype=np.float32)
    corners, normals = [], []
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        for side in (0.0, 1.0):
            face = np.full((6, 3), side, dtype=np.float32)
            face[:, others] = square
            normal = np.zeros((6, 3), dtype=np.float32)
            normal[:, axis] = 2 * side - 1
            corners.append(face.reshape(2, 3, 3))
            normals.append(normal.reshape(2, 3, 3))
    return np.concatenate(corners), np.concatenate(normals)


def boxes(low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]) -> Mesh:
    """Axis-parallel boxes, each between two corners."""
    low, high = np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32)
    corners, normals = _cube()
    n = len(low)
    placed = low[:, None, None] + corners[None] * (high - low)[:, None, None]
    uv = np.empty((n, 12, 3, 2), dtype=np.float32)
    for axis, (u, v) in enumerate(((1, 2), (0, 2), (0, 1))):
        uv[:, 4 * axis : 4 * axis + 4] = placed[:, 4 * axis : 4 * axis + 4][..., [u, v]]
    uv += (np.arange(n, dtype=np.float32) * 0.37)[:, None, None, None]
    return Mesh(
        placed.reshape(-1, 3, 3),
        np.broadcast_to(normals, (n, 12, 3, 3)).reshape(-1, 3, 3),
        uv.reshape(-1, 3, 2),
        np.repeat(np.arange(6 * n), 2),
    )


def box(low: Point, high: Point) -> Mesh:
    """One axis-parallel box."""
    return boxes(np.array([low]), np.array([high]))


def panel(low: Point, high: Point) -> Mesh:
    """A vertical rectangle in the plane y = low[1], with texture coordinates 0..1 upright."""
    (x0, y, z0), (x1, _, z1) = low, high
    quad = np.array([[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]], dtype=np.float32)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)
    order = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.zeros((2, 3, 3), dtype=np.float32)
    normals[..., 1] = 1
    return Mesh(quad[order], normals, uv[order], np.zeros(2, dtype=np.int64))


def flat_panel(width: float, depth: float) -> Mesh:
    """A rectangle on the floor, centred, with texture coordinates 0..1."""
    upright = panel([-width / 2, 0, -depth / 2], [width / 2, 0, depth / 2])
    return upright.turned(np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]))


def sheet(points: Float[np.ndarray, "rows columns 3"]) -> Mesh:
    """A smooth surface through a grid of points; a closed one repeats its first row or column."""
    points = np.asarray(points, dtype=np.float32)
    along, across = _tangent(points, 0), _tangent(points, 1)
    normals = unit(cross(across, along))
    flat = np.abs(normals).sum(axis=-1) < 0.5  # poles, where a whole row is one point
    normals[flat] = unit(points[flat] - points.reshape(-1, 3).mean(axis=0))
    uv = np.stack([_arc_length(points, 1), _arc_length(points, 0)], axis=-1)
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(
        points.reshape(-1, 3)[triangles],
        normals.reshape(-1, 3)[triangles],
        uv.reshape(-1, 2)[triangles],
        np.zeros(len(triangles), dtype=np.int64),
    )


def _tangent(
    points: Float32[np.ndarray, "rows columns 3"], axis: int
) -> Float32[np.ndarray, "rows columns 3"]:
    """Central differences along an axis; around the seam where the surface is closed there."""
    p = np.moveaxis(points, axis, 0)
    difference = np.empty_like(p)
    difference[1:-1] = p[2:] - p[:-2]
    if np.abs(p[0] - p[-1]).max() < 1e-5:
        difference[0] = difference[-1] = p[1] - p[-2]
    else:
        difference[0], difference[-1] = p[1] - p[0], p[-1] - p[-2]
    return np.moveaxis(difference, 0, axis)


def _arc_length(
    points: Float32[np.ndarray, "rows columns 3"], axis: int
) -> Float32[np.ndarray, "rows columns"]:
    steps = np.sqrt((np.diff(points, axis=axis) ** 2).sum(axis=-1))
    length = np.zeros(points.shape[:2], dtype=np.float32)
    if axis == 0:
        length[1:] = np.cumsum(steps, axis=0)
    else:
        length[:, 1:] = np.cumsum(steps.max(axis=0))[None]
    return length


def lathe(profile: Sequence[tuple[float, float]], sides: int = 20) -> Mesh:
    """A surface of revolution about z through (radius, height) pairs [m]."""
    radius, height = np.array(profile).T
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    return sheet(
        np.stack(
            [
                radius[:, None] * np.cos(angle),
                radius[:, None] * np.sin(angle),
                np.broadcast_to(height[:, None], (len(radius), sides + 1)),
            ],
            axis=-1,
        )
    )


def can(radius: float, low: float, high: float) -> Mesh:
    """A closed upright cylinder with crisp rims."""
    rim = [(radius, low), (radius, high)]
    return join([lathe([(0, low), rim[0]]), lathe(rim), lathe([rim[1], (0, high)])])


def pillow(size: Point, *, square: float = 0.5, resolution: int = 14) -> Mesh:
    """A superellipsoid about the origin: square 1 is an ellipsoid, 0.2 a rounded box."""
    return _unit_pillow(round(square, 1), resolution).scaled(size)


@cache
def _unit_pillow(square: float, resolution: int) -> Mesh:
    theta = np.linspace(-np.pi / 2, np.pi / 2, resolution)[:, None]
    phi = np.linspace(-np.pi, np.pi, 2 * resolution)[None]

    def power(values: Float[np.ndarray, "a b"]) -> Float[np.ndarray, "a b"]:
        return np.asarray(np.sign(values) * np.abs(values) ** square)

    ring = power(np.cos(theta))
    points = [ring * power(np.cos(phi)), ring * power(np.sin(phi)), power(np.sin(theta)) + 0 * phi]
    return sheet(np.stack(points, axis=-1) / 2)


def rods(
    starts: Float[np.ndarray, "n 3"], ends: Float[np.ndarray, "n 3"], radius: float, sides: int = 8
) -> Mesh:
    """Round open rods between pairs of points."""
    starts, ends = np.asarray(starts, dtype=np.float32), np.asarray(ends, dtype=np.float32)
    axis = unit(ends - starts)
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = unit(cross(axis, helper))
    other = cross(axis, side)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    around = np.cos(angle)[:, None, None] * side + np.sin(angle)[:, None, None] * other
    around = around.transpose(1, 0, 2).astype(np.float32)  # [n, sides + 1, 3]
    ring = np.stack([starts[:, None] + radius * around, ends[:, None] + radius * around], axis=1)
    arc, height = angle * radius, np.sqrt(((ends - starts) ** 2).sum(axis=1))
    uv = np.empty((*ring.shape[:3], 2), dtype=np.float32)
    uv[..., 0] = arc
    uv[:, 0, :, 1], uv[:, 1, :, 1] = 0.0, height[:, None]
    normals = np.broadcast_to(around[:, None], ring.shape)

    def split(values: Float32[np.ndarray, "n 2 k d"]) -> Float32[np.ndarray, "m 3 d"]:
        a, b, c, d = values[:, 0, :-1], values[:, 0, 1:], values[:, 1, 1:], values[:, 1, :-1]
        both = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], axis=2)
        return both.reshape(-1, 3, values.shape[-1])

    return Mesh(
        split(ring), split(normals), split(uv), np.repeat(np.arange(len(starts)), 2 * sides)
    )
