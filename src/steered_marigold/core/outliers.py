"""Which measurements to believe."""

import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from torch import Tensor

from steered_marigold.core.alignment import MAD_TO_SIGMA
from steered_marigold.core.neighbours import neighbouring

# Differences are of log depth. Thresholds were chosen on the tune frames so that at most .5 % of
# clean measurements are left out, of which most are the truth's own mixed pixels (docs/method.md).

# side of a cell of the map of usual distances from the prior, as a share of the image's diagonal,
# and cells whose median is taken: together 72 of 640x480 px, twice the width of a patch of 2000 px
CELL = 0.01
CELLS = 9
# sparse measurements have larger cells, so that each holds two or more
CELL_SPACINGS = 1.5
# a cell with fewer of them than this share of the usual number says nothing: readings in glass
FEW_IN_CELL = 0.2
# with a smaller share of cells that say something around a pixel, the whole image does
FEW_CELLS = 0.2
# this far from the usual distance, and DEVIATIONS of those around farther, contradicts the prior,
# if at least half of that is outside all of the prior nearby
CONTRADICTION = 0.35
DEVIATIONS = 2.0
UNEXPLAINED = 0.5
# how far a prior's edge may lie from the true one, as a share of the image's diagonal
EDGE_SHIFT = 0.013
# nearer, thinner than this and longer than that (shares of the diagonal), it is a pole or a chair's
# leg that the prior overlooked: what is false is rarely so shaped
THIN = 0.009
LONG = 0.04
# mixed pixels lie between both sides of an edge in a window of 11 px, and between their neighbours,
# by so much of the step and so far; a window of 23 px has no larger step, as it has on a slope
FLYING_WINDOW = 11
SLOPE_WINDOW = 23
BETWEEN = (0.12, 0.05)
BETWEEN_NEIGHBOURS = (0.1, 0.03)
SLOPE = 1.5
# where few of the edges are ramps, most of what is so found is a surface after all, and the gates
# are wider. Few: share of the pixels around edges whose neighbours span less than RAMP of the step
EDGE = 0.12
RAMP = 0.7
FEW_RAMPS = 0.07
WIDER = 2.0
# [px] between measurements, from which their surroundings say too little: with 5 % of the pixels
# measured (4.5 px) the other tests cost 20 % of RMSE on clean tune frames
SPARSE_SPACING = 3.0
# a measurement this many spreads from the prior is questioned, and needs neighbours that agree
GATE = 1.5
NEIGHBOURS = 8
AGREEING = 2
# least log-depth difference that counts as agreement: 5 % of depth
LEAST_TOLERANCE = 0.05
# neighbours are looked for within so many usual spacings
NEAR_SPACINGS = 4.0
SAMPLE = 500  # measurements whose differences from their neighbours say what is usual


@dataclass(frozen=True)
class Judgement:
    """trusted: the measurements to believe. doubted: regions of measurements, trusted or not, that
    contradict the prior and their surroundings: neither side is sure there.
    """

    trusted: Bool[Tensor, "height width"]
    doubted: Bool[Tensor, "height width"]


def trusted_measurements(
    prior: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> Bool[Tensor, "height width"]:
    """The measurements to believe, see `judge_measurements`."""
    return judge_measurements(prior, sparse_depth, mask).trusted


def judge_measurements(
    prior: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> Judgement:
    """Which measurements to believe, given a positive metric prior [m].

    The prior alone cannot tell a wrong measurement from a right one that it did not foresee. Left
    out are those that
    - contradict it: far from what is usual around them (an object that is larger than half of the
      surroundings is what is usual), and from all of the prior nearby, whose edges are a little
      misplaced; but not where they are thin, long and nearer;
    - fly: lie between both sides of a depth edge, and between their own neighbours;
    - stand alone: off the prior and all of it nearby, and fewer than two of their eight nearest
      neighbours agree in depth or in distance from the prior.
    Sparse measurements are judged by the last alone: what lies between them is not known.
    All gates widen with the spread found in the data. Four measurements or fewer are believed.
    """
    if int(mask.sum()) <= 4:
        return Judgement(mask, torch.zeros_like(mask))
    measured = mask.cpu().numpy()
    depth = torch.where(mask, sparse_depth, 1.0).log().cpu().numpy().astype(np.float32)
    expected = prior.log().cpu().numpy().astype(np.float32)
    spacing = math.sqrt(measured.size / np.count_nonzero(measured))
    residual = depth - expected
    usual, deviation = _usual(residual, measured, spacing)
    offset = residual - usual
    window = 2 * round(EDGE_SHIFT * math.hypot(*measured.shape)) + 1
    nearest, farthest = _extremes(expected, expected, window)
    unexplained = np.maximum(nearest - (depth - usual), (depth - usual) - farthest)
    against = measured & (np.abs(offset) > CONTRADICTION + DEVIATIONS * deviation)
    against &= unexplained > UNEXPLAINED * np.abs(offset)
    dense = spacing < SPARSE_SPACING
    against &= dense
    against = (against & (offset > 0)) | _without_thin(against & (offset < 0))
    left_out = _alone(depth, residual, measured & ~against, spacing) & (unexplained > 0)
    left_out |= against
    if dense:
        left_out |= _flying(depth, measured & ~left_out)
    if not (measured & ~left_out).any():  # with none believed there would be no answer
        left_out[:] = False
    trusted = torch.from_numpy(measured & ~left_out).to(mask.device)
    return Judgement(trusted, torch.from_numpy(against).to(mask.device))


def _usual(
    residual: NDArray[np.float32], measured: NDArray[np.bool_], spacing: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The median distance from the prior around each pixel, and the usual deviation from it.

    Medians over cells, then over CELLS x CELLS of them; between cells linear.
    """
    height, width = residual.shape
    side = max(1, round(CELL * math.hypot(height, width)), math.ceil(CELL_SPACINGS * spacing))
    rows, columns = -(-height // side), -(-width // side)
    padded = np.full((rows * side, columns * side), np.nan, np.float32)
    padded[:height, :width] = np.where(measured, residual, np.nan)
    cells = padded.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    medians, counts = _medians(cells)
    few = counts < FEW_IN_CELL * np.median(counts[counts > 0])
    medians[few | (counts == 0)] = np.nan
    usual = _median_around(medians)
    both = torch.from_numpy(np.stack((usual, _median_around(np.abs(medians - usual)))))[None]
    size = (rows * side, columns * side)
    fine = F.interpolate(both, size=size, mode="bilinear")[0, :, :height, :width].numpy()
    return fine[0], fine[1]


def _median_around(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """The median of the CELLS x CELLS around each, but of NaN; of all cells if few are left."""
    padded = np.pad(cells, CELLS // 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (CELLS, CELLS))
    medians, known = _medians(windows.reshape(*cells.shape, -1))
    return np.where(known < FEW_CELLS * CELLS**2, _medians(cells.reshape(1, -1))[0], medians)


def _medians(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Of the last axis, the lower one of two; and of how many numbers, for NaN is none.

    NumPy's sort is many times faster here than PyTorch's `nanmedian`, and puts NaN last.
    """
    counts = np.count_nonzero(~np.isnan(values), axis=-1)
    middle = (np.maximum(counts, 1) - 1) // 2
    return np.take_along_axis(np.sort(values, axis=-1), middle[..., None], -1)[..., 0], counts


def _without_thin(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The region without its thin and long connected parts."""
    diagonal = math.hypot(*region.shape)
    side = 2 * round(THIN * diagonal / 2) + 1
    labels, count = ndimage.label(region, np.ones((3, 3)))
    if count == 0:
        return region
    thick = np.zeros(count + 1, bool)
    thick[np.unique(labels[ndimage.minimum_filter(region, side, mode="constant")])] = True
    extent = [math.hypot(*(s.stop - s.start for s in box)) for box in ndimage.find_objects(labels)]
    spared = ~thick[1:] & (np.array(extent) >= LONG * diagonal)
    thin: NDArray[np.bool_] = np.concatenate(([False], spared))[labels]
    return region & ~thin


def _flying(depth: NDArray[np.float32], measured: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Measurements that mix both sides of a depth edge."""
    low, high = np.where(measured, depth, np.inf), np.where(measured, depth, -np.inf)
    nearest, farthest = _extremes(low, high, FLYING_WINDOW)
    y, x = np.nonzero(measured & (farthest - nearest > EDGE))
    value, step = depth[y, x], (farthest - nearest)[y, x]
    between = np.minimum(value - nearest[y, x], farthest[y, x] - value)
    nearest, farthest = (sides[y, x] for sides in _extremes(low, high, 3))
    beside, span = np.minimum(value - nearest, farthest - value), farthest - nearest
    nearest, farthest = (sides[y, x] for sides in _extremes(low, high, SLOPE_WINDOW))
    edge = farthest - nearest < SLOPE * step

    # by how much they exceed the gates, where 1 is just so
    excess = np.minimum(
        between / np.maximum(BETWEEN[0] * step, BETWEEN[1]),
        beside / np.maximum(BETWEEN_NEIGHBOURS[0] * step, BETWEEN_NEIGHBOURS[1]),
    )
    flying = edge & (excess > 1)
    if np.count_nonzero(flying & (span < RAMP * step)) < FEW_RAMPS * np.count_nonzero(edge):
        flying = edge & (excess > WIDER)
    result = np.zeros_like(measured)
    result[y[flying], x[flying]] = True
    return result


def _extremes(
    low: NDArray[np.float32], high: NDArray[np.float32], side: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least of `low` and greatest of `high` in a square window."""
    return -_greatest(-low, side), _greatest(high, side)


def _greatest(values: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """The greatest of a square window, an odd number wide, cut at the borders.

    Windows grow from overlapping halves: a fraction of the time of `ndimage.maximum_filter`.
    """
    for _ in range(2):  # columns, then rows
        around = np.pad(values, ((side // 2, side // 2), (0, 0)), constant_values=-np.inf)
        width = 1
        while width < side:
            grown = min(2 * width, side)
            around = np.maximum(around[: len(around) - (grown - width)], around[grown - width :])
            width = grown
        values = around.T
    return values


def _alone(
    depth: NDArray[np.float32],
    residual: NDArray[np.float32],
    measured: NDArray[np.bool_],
    spacing: float,
) -> NDArray[np.bool_]:
    """Measurements off the prior whose neighbours agree in neither depth nor distance from it."""
    off = residual - np.median(residual[measured])
    questioned = measured & (np.abs(off) > GATE * MAD_TO_SIGMA * np.median(np.abs(off[measured])))
    questioned &= _agreeing_beside(depth, measured) < AGREEING
    result = np.zeros_like(measured)
    if not questioned.any():
        return result
    # how much neighbours differ where nothing is wrong, from an even sample
    every = np.flatnonzero(measured)
    sample = np.zeros_like(measured)
    sample.flat[every[np.linspace(0, len(every) - 1, SAMPLE).astype(np.int64)]] = True
    reach = 2 * math.ceil(NEAR_SPACINGS * spacing) + 1
    points = np.argwhere(measured & ndimage.maximum_filter(questioned | sample, reach))
    tree = cKDTree(points)
    y, x = points.T
    count = min(NEIGHBOURS, len(points) - 1)
    if count == 0:
        return result
    taken = np.flatnonzero(sample[y, x])
    beside = tree.query(points[taken], 2)[1][:, 1]
    usual = np.abs(residual[y, x][taken] - residual[y, x][beside])
    tolerance = max(3 * float(np.median(usual)), LEAST_TOLERANCE)
    ask = np.flatnonzero(questioned[y, x])
    around = tree.query(points[ask], count + 1, workers=torch.get_num_threads())[1][:, 1:]
    same = [np.abs(v[ask, None] - v[around]) < tolerance for v in (depth[y, x], residual[y, x])]
    alone = ask[(same[0] | same[1]).sum(axis=1) < min(AGREEING, count)]
    result[y[alone], x[alone]] = True
    return result


def _agreeing_beside(depth: NDArray[np.float32], measured: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """How many of the eight pixels around each are measured and agree in depth.

    They are the nearest of all: with AGREEING of them, no tree need be asked.
    """
    agreeing = np.zeros(depth.shape, np.uint8)
    for here, there, *_ in neighbouring(*depth.shape):
        same = measured[here] & measured[there]
        same &= np.abs(depth[here] - depth[there]) < LEAST_TOLERANCE
        agreeing[here] += same
        agreeing[there] += same
    return agreeing
