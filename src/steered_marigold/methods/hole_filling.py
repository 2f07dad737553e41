"""The filters of depth cameras that fill holes: those of librealsense, in NumPy."""

from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage

from steered_marigold.methods.classical import ClassicalCompleter

Mode = Literal["left", "farthest", "nearest"]
DepthMap = Float[np.ndarray, "height width"]


class HoleFillingFilter(ClassicalCompleter):
    """librealsense's hole-filling filter (`src/proc/hole-filling-filter.h`, v2.59).

    mode: "left": a hole gets the pixel on its left; "farthest" (the default there): the largest of
    five neighbours (above left, above, left, below left, below); "nearest": the smallest of them,
    if the pixel above is not empty. In one pass, row by row from the top left, so that what was
    filled fills on; the first and the last row and the first column are left out of the latter two.

    What the filter leaves open is filled from the nearest pixel that is not. Measured pixels keep
    their values, the image is ignored.
    """

    def __init__(self, mode: Mode) -> None:
        self.name = f"realsense-{mode}"
        self._mode = mode

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: DepthMap,
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> DepthMap:
        return _from_nearest(fill_holes(sparse_depth, self._mode))


class SpatialFilter(ClassicalCompleter):
    """librealsense's spatial filter (`src/proc/spatial-filter.h`, v2.59), then its hole filling.

    An edge-preserving recursive average along rows and columns, both ways (Gastal and Oliveira,
    "Domain Transform for Edge-Aware Image and Video Processing", SIGGRAPH 2011), with the defaults
    there: two rounds, weight .5, edges from 20 mm on; and with the largest of its radii for holes,
    254 px along rows, each way and round. `HoleFillingFilter("farthest")` follows, as in
    librealsense's order of filters. On depth in whole millimetres, not on disparity, which needs
    the baseline of a stereo camera.

    Measured pixels are smoothed too, and rounded. The image is ignored.
    """

    name = "realsense-spatial"

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: DepthMap,
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> DepthMap:
        smoothed_mm = smooth(np.round(1000 * sparse_depth))
        return _from_nearest(fill_holes(smoothed_mm, "farthest")) / 1000


def fill_holes(depth: DepthMap, mode: Mode) -> DepthMap:
    """The hole-filling filter; 0 is a hole, also in the answer."""
    if mode == "left":
        columns = np.where(depth > 0, np.arange(depth.shape[1]), 0)
        last = np.maximum.accumulate(columns, axis=1)
        return np.take_along_axis(depth, last, axis=1)
    filled = depth.copy()
    # a power of two, so that adding a multiple of it to a depth takes no digit from a float64
    span = 2.0 ** np.ceil(np.log2(max(float(depth.max()), 1.0)) + 1)
    for y in range(1, len(depth) - 1):
        if not filled[y, 1:].all():
            fill = _farthest if mode == "farthest" else _nearest
            above, row, below = filled[y - 1 : y + 2]
            filled[y] = fill(above, row, below, span)
    return filled


Row = Float[np.ndarray, " width"]


def _farthest(above: Row, row: Row, below: Row, span: float) -> Row:
    """The row, a hole filled with the largest of its neighbours, left ones filled before it."""
    vertical = np.maximum(above, below)
    candidates = np.maximum(vertical[1:], vertical[:-1])
    return _running_maximum(row, candidates, row[1:] == 0, span)


def _nearest(above: Row, row: Row, below: Row, span: float) -> Row:
    """The row, a hole under a pixel that is not one filled with the smallest of its neighbours."""
    # the largest of span - depth, in which a hole is as small as nothing
    back = [np.where(depths > 0, span - depths, 0) for depths in (above, below, row)]
    vertical = np.maximum(back[0], back[1])
    candidates = np.maximum(vertical[1:], vertical[:-1])
    holes = (row[1:] == 0) & (above[1:] > 0)
    filled = _running_maximum(back[2], candidates, holes, span)
    return np.where(filled > 0, span - filled, 0)


def _running_maximum(
    row: Row,
    candidates: Float[np.ndarray, " holes"],
    holes: Bool[np.ndarray, " holes"],
    span: float,
) -> Row:
    """Each hole, from left to right, becomes the larger of its candidate and the pixel left of it.

    candidates and holes are of the row without its first pixel.
    """
    # every pixel that is no hole starts a level of its own, above all values before it
    levels = span * np.cumsum(np.concatenate(([False], ~holes)))
    values = np.concatenate((row[:1], np.where(holes, candidates, row[1:]))).astype(np.float64)
    return np.maximum.accumulate(values + levels) - levels


ROUNDS = 2
EDGE_MM = 20
RADIUS_PX = 255


def smooth(depth_mm: DepthMap) -> DepthMap:
    """The spatial filter on whole millimetres; 0 is a hole, also in the answer."""
    smoothed = depth_mm.copy()
    for _ in range(ROUNDS):
        columns = np.ascontiguousarray(smoothed.T)
        # librealsense stops one pixel early on the way to the right
        _smooth_forward(columns[:-1], alike_mm=EDGE_MM, fill=True)
        _smooth_forward(columns[::-1], alike_mm=EDGE_MM, fill=True)
        smoothed = np.ascontiguousarray(columns.T)
        _smooth_forward(smoothed, alike_mm=EDGE_MM - 1, fill=False)
        _smooth_forward(smoothed[::-1], alike_mm=EDGE_MM - 1, fill=False)
    return smoothed


def _smooth_forward(lines: Float[np.ndarray, "lines pixels"], *, alike_mm: int, fill: bool) -> None:
    """Averages each line with the one before it where they differ by up to `alike_mm`, in place.

    fill: a hole takes the value before it, for up to RADIUS_PX - 1 holes in a row.
    """
    holes_in_a_row = np.zeros(lines.shape[1], np.int64)
    for before, here in pairwise(lines):
        both = (before > 0) & (here > 0)
        if fill:
            hole = (before > 0) & (here == 0)
            holes_in_a_row = np.where(both, 0, holes_in_a_row + hole)
            np.copyto(here, before, where=hole & (holes_in_a_row < RADIUS_PX))
        alike = both & (np.abs(here - before) <= alike_mm)
        np.copyto(here, np.floor((here + before + 1) / 2), where=alike)


def _from_nearest(depth: DepthMap) -> DepthMap:
    """What is 0 becomes the depth of the nearest pixel that is not."""
    if depth.all():
        return depth
    rows, columns = ndimage.distance_transform_edt(
        depth == 0, return_distances=False, return_indices=True
    )
    return np.asarray(depth[rows, columns])
