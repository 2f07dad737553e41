"""Where steering looks: the positions P (the paper, section III-C)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Int
from scipy import ndimage
from torch import Tensor

CORNERS = ([0, 0, -1, -1], [0, -1, 0, -1])


@dataclass(frozen=True)
class Anchors:
    """Positions P of one image.

    points: (x, y) [px] in row-major order of the pixels. known: True where depth was measured.
    """

    points: Int[Tensor, "points 2"]
    known: Bool[Tensor, " points"]


def neighborhood_ellipse(neighborhood_px: int) -> npt.NDArray[np.bool_]:
    """The digital ellipse of side 2 * neighborhood_px - 1 that OpenCV draws (the paper's zeta).

    Row i spans round(r * sqrt(r^2 - (i - r)^2) / r) pixels to each side of the centre,
    r = neighborhood_px - 1.
    """
    radius = max(neighborhood_px - 1, 0)
    offset = np.arange(-radius, radius + 1)
    reach = np.rint(np.sqrt(radius**2 - offset**2))
    ellipse: npt.NDArray[np.bool_] = np.abs(offset)[None, :] <= reach[:, None]
    return ellipse


def far_from_known(
    valid_mask: Bool[Tensor, "height width"], neighborhood_px: int
) -> Bool[Tensor, "height width"]:
    """True outside the neighbourhood of every known pixel; everywhere if neighborhood_px is 0."""
    if neighborhood_px <= 0:
        return torch.ones_like(valid_mask)
    # row by row of the ellipse: a third of the time of `binary_dilation`
    known = valid_mask.cpu().numpy()
    near = np.zeros_like(known)
    height = known.shape[0]
    ellipse = neighborhood_ellipse(neighborhood_px)
    radius = len(ellipse) // 2
    for i, row in enumerate(ellipse):
        spread = ndimage.maximum_filter1d(known, int(row.sum()), axis=1, mode="constant")
        shift = i - radius
        to = slice(max(shift, 0), height + min(shift, 0))
        source = slice(max(-shift, 0), height + min(-shift, 0))
        near[to] |= spread[source]
    return torch.from_numpy(~near)


def select_anchors(
    known: Bool[Tensor, "height width"],
    far: Bool[Tensor, "height width"],
    *,
    anchor_fraction: float,
    generator: torch.Generator,
) -> Anchors:
    """All known pixels, a random share of all pixels kept where `far`, and the four corners.

    anchor_fraction: share of all pixels that is drawn (0.05 in the paper), measured or not.
    generator: a CPU generator.
    """
    height, width = known.shape
    drawn = torch.randperm(height * width, generator=generator)
    chosen = torch.zeros(height * width, dtype=torch.bool)
    chosen[drawn[: round(anchor_fraction * height * width)]] = True
    positions = known | (chosen.view(height, width) & far)
    positions[CORNERS] = True
    points = positions.nonzero().flip(-1)
    return Anchors(points, known[points[:, 1], points[:, 0]])


def thin_measurements(
    known: Bool[Tensor, "height width"], max_anchors: int, *, cell: int = 8
) -> Bool[Tensor, "height width"]:
    """At most about max_anchors of the known pixels, for steering only.

    Kept are the known pixel nearest to the centre of each cell of `cell` x `cell` pixels (one
    latent position), and those at the borders of holes wider than a cell, where a large part of
    the image hangs on what was measured; and the image's corners, which are always anchors. If
    they are too many, the borders are thinned evenly, then the cells.
    """
    if int(known.sum()) <= max_anchors:
        return known
    mask = known.numpy()
    centres = _nearest_to_cell_centres(mask, cell)
    side = cell + 1 - cell % 2  # an odd window is symmetric
    wide_holes = ndimage.maximum_filter(ndimage.minimum_filter(~mask, side), side)
    borders = np.flatnonzero(mask & ndimage.maximum_filter(wide_holes, 3) & ~centres)
    without_corners = max(max_anchors - len(CORNERS[0]), 0)
    budget = max(without_corners - int(centres.sum()), 0)
    kept = np.flatnonzero(centres)
    kept = np.concatenate((_evenly(kept, without_corners), _evenly(borders, budget)))
    thinned = np.zeros_like(mask)
    thinned.flat[kept] = True
    thinned[CORNERS] = mask[CORNERS]
    return torch.from_numpy(thinned)


def _nearest_to_cell_centres(mask: npt.NDArray[np.bool_], cell: int) -> npt.NDArray[np.bool_]:
    """The one True pixel of each cell that is nearest to the cell's centre; ties: the first."""
    y, x = np.nonzero(mask)
    middle = (cell - 1) / 2
    distance = (y % cell - middle) ** 2 + (x % cell - middle) ** 2
    owner = (y // cell) * (mask.shape[1] // cell + 1) + x // cell
    order = np.lexsort((distance, owner))
    first = np.r_[True, np.diff(owner[order]) != 0]
    nearest = np.zeros_like(mask)
    nearest[y[order[first]], x[order[first]]] = True
    return nearest


def _evenly(indices: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """At most `count` of the indices, evenly spaced."""
    if len(indices) <= count:
        return indices
    return (
        indices[np.linspace(0, len(indices) - 1, count).astype(np.int64)] if count else indices[:0]
    )
