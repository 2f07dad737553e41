"""Scattered values to maps: linearly (the paper's phi), triangulated once, or by push-pull."""

from copy import copy
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, QhullError, cKDTree
from torch import Tensor

from steered_marigold.errors import NoMeasurementsError

Array = npt.NDArray[np.float64]
# least denominator of a mean; what it divides is 0 too
TINY = 1e-12


class ScatteredInterpolant:
    """Linear interpolation over the Delaunay triangulation of `points`, at every pixel.

    points: (x, y) [px], distinct, pixel centres at integer coordinates. shape: (height, width).
    Building it finds three vertices and barycentric weights for every pixel; applying it is a
    gather and a weighted sum, linear in the values. Outside the convex hull, and everywhere if
    the points lie on one line or are fewer than three, a pixel takes its nearest point's value.

    Raises NoMeasurementsError without points.
    """

    vertices: Int[Tensor, "3 pixels"]
    weights: Float[Tensor, "3 pixels"]

    def __init__(self, points: Int[Tensor, "points 2"], shape: tuple[int, int]) -> None:
        if len(points) == 0:
            raise NoMeasurementsError("interpolation needs at least one point")
        self.shape = shape
        coordinates = points.cpu().numpy().astype(np.float64)
        vertices, weights = _barycentric(coordinates, shape)
        outside = np.flatnonzero(vertices[0] < 0)
        if len(outside):
            y, x = np.divmod(outside, shape[1])
            vertices[:, outside] = cKDTree(coordinates).query(np.stack((x, y), axis=-1))[1]
            weights[:, outside] = [[1.0], [0.0], [0.0]]
        self.vertices = torch.from_numpy(vertices)
        self.weights = torch.from_numpy(weights)

    def to(self, device: torch.device | str) -> "ScatteredInterpolant":
        """The same on the device that values will be on."""
        moved = copy(self)
        moved.vertices, moved.weights = self.vertices.to(device), self.weights.to(device)
        return moved

    def __call__(
        self, values: Float[Tensor, "*batch points"]
    ) -> Float[Tensor, "*batch height width"]:
        """The interpolated map of each row of values, on this interpolant's device."""
        rows = values.reshape(-1, values.shape[-1])
        result = self.weights[0] * rows.index_select(1, self.vertices[0])
        for vertex, weight in zip(self.vertices[1:], self.weights[1:], strict=True):
            result.addcmul_(weight, rows.index_select(1, vertex))
        return result.to(values.dtype).reshape(*values.shape[:-1], *self.shape)


def remembered_interpolant(
    points: Int[Tensor, "points 2"], shape: tuple[int, int]
) -> ScatteredInterpolant:
    """As `ScatteredInterpolant(points, shape)`; the last few are kept, for videos."""
    return _remembered(points.cpu().numpy().astype(np.int64).tobytes(), shape)


@lru_cache(maxsize=4)
def _remembered(points: bytes, shape: tuple[int, int]) -> ScatteredInterpolant:
    pairs = np.frombuffer(points, np.int64).reshape(-1, 2).copy()
    return ScatteredInterpolant(torch.from_numpy(pairs), shape)


def push_pull(
    values: Float[Tensor, "height width"], weight: Float[Tensor, "height width"]
) -> Float[Tensor, "height width"]:
    """Fills in the values where the weight, in [0, 1], is less than 1: the wider a gap, the
    smoother.

    values: as weighted, so 0 where the weight is 0. A pyramid of weighted means is built, and its
    levels are blended from the coarsest on (Gortler et al., "The Lumigraph", SIGGRAPH 1996,
    section 3.4). A hundredth of a triangulation's time; without any weight the result is 0.
    """
    height, width = values.shape
    if max(height, width) == 1:
        return values / weight.clamp(min=TINY)
    pair = F.pad(torch.stack((values, weight)), (0, width % 2, 0, height % 2))
    sums = F.avg_pool2d(pair[None], 2, divisor_override=1)[0]
    coarse_weight = sums[1].clamp(max=1)
    coarse = push_pull(sums[0] * (coarse_weight / sums[1].clamp(min=TINY)), coarse_weight)
    fine = F.interpolate(coarse[None, None], size=pair.shape[1:], mode="bilinear")
    return values + (1 - weight) * fine[0, 0, :height, :width]


def _barycentric(
    points: Array, shape: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Vertices (-1 outside the hull) and weights of every pixel, [3, pixels] each."""
    height, width = shape
    vertices = np.full((3, height * width), -1, dtype=np.int64)
    weights = np.zeros((3, height * width), dtype=np.float32)
    try:
        simplices = Delaunay(points).simplices
    except (QhullError, ValueError):  # on one line, or fewer than three points
        return vertices, weights
    a, b, c = points[simplices].transpose(1, 0, 2)
    area = _cross(b - a, c - a)
    simplices, area = simplices[area != 0], area[area != 0]
    triangle, x, y = _scan_convert(points[simplices], shape)
    a, b, c = points[simplices[triangle]].transpose(1, 0, 2)
    pixel = np.stack((x, y), axis=-1)
    weight_b = _cross(pixel - a, c - a) / area[triangle]
    weight_c = _cross(b - a, pixel - a) / area[triangle]
    index = y * width + x
    vertices[:, index] = simplices[triangle].T
    weights[:, index] = np.stack((1 - weight_b - weight_c, weight_b, weight_c))
    return vertices, weights


def _scan_convert(
    triangles: Array, shape: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """(triangle, x, y) of every pixel inside or on the edge of triangles [triangles, 3, (x, y)].

    Row by row, so the cost is that of the rows that triangles cross plus that of the pixels:
    one search for each pixel (`Delaunay.find_simplex`) takes several times as long.
    """
    height, width = shape
    first = np.clip(np.ceil(triangles[..., 1].min(axis=1)), 0, height).astype(np.int64)
    last = np.clip(np.floor(triangles[..., 1].max(axis=1)), -1, height - 1).astype(np.int64)
    triangle, y = _expand(first, last)
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    corners = triangles[triangle]
    for i in range(3):
        (xa, ya), (xb, yb) = corners[:, i].T, corners[:, i - 1].T
        level = ya == yb
        x = xa + (y - ya) * (xb - xa) / np.where(level, 1, yb - ya)
        crossed = (np.minimum(ya, yb) <= y) & (y <= np.maximum(ya, yb))
        # a level edge is covered by the corners that its neighbours bring
        left = np.where(crossed & ~level, np.minimum(left, x), left)
        right = np.where(crossed & ~level, np.maximum(right, x), right)
    slack = 1e-9 * max(shape)  # rounding must leave no gap between neighbours
    span, x = _expand(
        np.clip(np.ceil(left - slack), 0, width).astype(np.int64),
        np.clip(np.floor(right + slack), -1, width - 1).astype(np.int64),
    )
    return triangle[span], x, y[span]


def _expand(
    first: npt.NDArray[np.int64], last: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """(i, n) for every n in first[i]..last[i], in order of i."""
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(count)), count)
    start = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - start[owner] + first[owner]


def _cross(u: Array, v: Array) -> Array:
    """The z component of the cross product of (x, y) vectors."""
    product: Array = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return product
