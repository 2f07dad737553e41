"""How depth goes missing or wrong: samples, holes, ranges, scan lines, noise and outliers.

Each function takes a frame and returns it with fewer or worse measurements, so they compose. A
frame whose measurements are a dense ground truth is where a chain begins; what is not kept is
zeroed, so that a hidden truth cannot leak.
"""

import math
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from torch import Generator

from steered_marigold.core.frame import Frame
from steered_marigold.core.neighbours import neighbouring
from steered_marigold.errors import InputError

_BRIDGED_PX = 3  # measurements up to twice as far apart belong to the same measured area
HALVES = ("near", "far", "bottom", "left")
_FOOTPRINT = 5  # side [px] of what a pixel of a time-of-flight camera averages at a depth edge
_PATCH_PX = (50, 2000)
# log of the factor by which a patch is wrong: as a mirror or a wet floor has it, or worse
_PATCH_LOG = (math.log(1.3), math.log(4))


def sample_uniform(frame: Frame, count: int, *, generator: Generator) -> Frame:
    """`count` of the measurements, drawn without replacement; all where there are no more.

    A fraction of the image is `fraction_to_count` pixels.
    """
    candidates = frame.valid_mask.flatten().nonzero()[:, 0]
    order = torch.randperm(len(candidates), generator=generator)
    chosen = torch.zeros(frame.valid_mask.numel(), dtype=torch.bool)
    chosen[candidates[order[:count]]] = True
    return frame.keep(chosen.view_as(frame.valid_mask))


def fraction_to_count(fraction: float, size: tuple[int, int]) -> int:
    """How many pixels of an image of `size` (height, width) a fraction is (the paper: 5 %).

    Raises InputError unless 0 < fraction <= 1.
    """
    if not 0 < fraction <= 1:
        raise InputError(f"the fraction of samples must be in (0, 1], not {fraction}")
    return round(fraction * size[0] * size[1])


def erase_rectangle(frame: Frame, rows: slice, columns: slice) -> Frame:
    """Without the measurements in a rectangle."""
    outside = torch.ones_like(frame.valid_mask)
    outside[rows, columns] = False
    return frame.keep(outside)


def limit_range(frame: Frame, max_depth: float) -> Frame:
    """Without the measurements beyond `max_depth` [m]."""
    return frame.keep(frame.sparse_depth <= max_depth)


def keep_half(frame: Frame, half: str) -> Frame:
    """Those not beyond the median depth ("near"), beyond it ("far"), or in half of the image.

    Raises InputError unless `half` is one of HALVES.
    """
    if half not in HALVES:
        raise InputError(f"half {half!r}: choose one of {', '.join(HALVES)}")
    depth, valid = frame.sparse_depth, frame.valid_mask
    height, width = valid.shape
    if half == "bottom":
        return erase_rectangle(frame, slice(0, height // 2), slice(0, width))
    if half == "left":
        return erase_rectangle(frame, slice(0, height), slice(width // 2, width))
    near = depth <= depth[valid].median() if bool(valid.any()) else valid
    return frame.keep(near if half == "near" else ~near)


def scan_lines(frame: Frame, lines: int, *, generator: Generator) -> Frame:
    """Only `lines` image rows, evenly spaced from a random start: a spinning LiDAR.

    Lines of equal elevation are taken as straight rows, which holds near the optical axis.

    Raises InputError unless there is at least one line and a row for each.
    """
    height = frame.valid_mask.shape[0]
    if not 1 <= lines <= height:
        raise InputError(f"an image of {height} rows cannot have {lines} scan lines")
    start = torch.rand((), generator=generator, dtype=torch.float64)
    rows = ((torch.arange(lines, dtype=torch.float64) + start) * height / lines).long()
    on_line = torch.zeros_like(frame.valid_mask)
    on_line[rows] = True
    return frame.keep(on_line)


def remove_blobs(frame: Frame, count: int, *, generator: Generator) -> Frame:
    """Without `count` ellipses of random place and angle: objects that a sensor cannot see.

    Half axes are uniform in 10 to 30 % of the image's shorter side; centres lie in the image.
    """
    height, width = frame.valid_mask.shape
    y = torch.arange(height, dtype=torch.float64)[:, None]
    x = torch.arange(width, dtype=torch.float64)[None, :]
    seen = torch.ones_like(frame.valid_mask)
    for draw in torch.rand(count, 5, generator=generator, dtype=torch.float64).tolist():
        center_y, center_x, angle = draw[0] * height, draw[1] * width, draw[2] * math.pi
        a, b = ((0.1 + 0.2 * part) * min(height, width) for part in draw[3:])
        along = (x - center_x) * math.cos(angle) + (y - center_y) * math.sin(angle)
        across = (y - center_y) * math.cos(angle) - (x - center_x) * math.sin(angle)
        seen &= (along / a) ** 2 + (across / b) ** 2 > 1
    return frame.keep(seen)


def remove_square(frame: Frame, side: int, *, generator: Generator) -> Frame:
    """Without a square of `side` [px] at a random place inside the image.

    Raises InputError unless the image is larger.
    """
    height, width = frame.valid_mask.shape
    if side >= min(height, width):
        raise InputError(f"an image of {width}x{height} px has no room for a square of {side} px")
    top = int(torch.randint(height - side, (), generator=generator))
    left = int(torch.randint(width - side, (), generator=generator))
    return erase_rectangle(frame, slice(top, top + side), slice(left, left + side))


def remove_region(frame: Frame, fraction: float, *, generator: Generator) -> Frame:
    """Without a connected region that holds `fraction` of the connected measured area.

    That area is the largest set of measurements whose gaps are at most 6 px, so that the pattern of
    a sensor's sampling does not cut it. The region grows inside it, from a random measurement, by
    the length of the way there.

    Raises InputError unless 0 < fraction < 1.
    """
    if not 0 < fraction < 1:
        raise InputError(f"the fraction of a region must be in (0, 1), not {fraction}")
    valid = frame.valid_mask.numpy()
    if not valid.any():
        return frame.keep(frame.valid_mask)
    near = ndimage.distance_transform_edt(~valid) <= _BRIDGED_PX
    label, _ = ndimage.label(near, np.ones((3, 3)))
    area = label == np.bincount(label[valid]).argmax()
    candidates = np.flatnonzero(area & valid)
    start = int(candidates[int(torch.randint(len(candidates), (), generator=generator))])
    nearest = np.argsort(_way_within(area, start)[candidates], kind="stable")
    seen = torch.ones(valid.size, dtype=torch.bool)
    seen[candidates[nearest[: max(1, round(fraction * len(candidates)))]]] = False
    return frame.keep(seen.view_as(frame.valid_mask))


def add_noise(frame: Frame, sigma: float, *, generator: Generator) -> Frame:
    """Gaussian noise with a standard deviation of `sigma` times the depth.

    A measurement that the noise makes zero or negative is dropped.
    """
    noise = torch.randn(frame.sparse_depth.shape, generator=generator)
    noisy = frame.sparse_depth * (1 + sigma * noise)
    return replace(frame, sparse_depth=noisy).keep(noisy > 0)


def add_outliers(
    frame: Frame,
    fraction: float,
    *,
    generator: Generator,
    low: float = 0.3,
    high: float = 10.0,
) -> Frame:
    """Replaces a random fraction of the measurements by depths uniform in [low, high] m.

    Raises InputError unless 0 <= fraction <= 1.
    """
    if not 0 <= fraction <= 1:
        raise InputError(f"the fraction of outliers must be in [0, 1], not {fraction}")
    count = round(fraction * int(frame.valid_mask.sum()))
    hit = sample_uniform(frame, count, generator=generator).valid_mask
    wrong = low + (high - low) * torch.rand(hit.shape, generator=generator)
    depth = torch.where(hit, wrong, frame.sparse_depth)
    return replace(frame, sparse_depth=depth).keep(frame.valid_mask)


def add_flying_pixels(
    frame: Frame,
    dense: Frame,
    fraction: float,
    *,
    least: float,
    generator: Generator,
) -> Frame:
    """A random fraction of the measurements at depth edges becomes a mixture of both sides.

    dense: all depth [m], which says where edges are: the mixture is the mean over 5x5 pixels, as
    the footprint of a time-of-flight pixel gives, and replaces what it changes by more than `least`
    [m].

    Raises InputError unless 0 <= fraction <= 1.
    """
    if not 0 <= fraction <= 1:
        raise InputError(f"the fraction of flying pixels must be in [0, 1], not {fraction}")
    weight = dense.valid_mask.double()
    values = torch.where(dense.valid_mask, dense.sparse_depth, 0.0).double()
    total, count = (
        torch.from_numpy(ndimage.uniform_filter(x.numpy(), _FOOTPRINT)) for x in (values, weight)
    )
    mixture = (total / count.clamp(min=1 / _FOOTPRINT**2)).float()
    flying = (mixture - frame.sparse_depth).abs() > least
    flying &= torch.rand(flying.shape, generator=generator) < fraction
    depth = torch.where(flying, mixture, frame.sparse_depth)
    return replace(frame, sparse_depth=depth).keep(frame.valid_mask)


def add_patches(frame: Frame, count: int, *, generator: Generator) -> Frame:
    """Makes `count` connected regions wrong: ellipses of 50 to 2000 px around measurements.

    Depth is multiplied (a mirror, a wet floor), or one flat false depth (a pane, a stuck block), by
    turns: 1.3 to 4 times too far or too near. Areas and factors are log-uniform.
    """
    depth, valid = frame.sparse_depth, frame.valid_mask
    candidates = valid.nonzero()
    y = torch.arange(valid.shape[0], dtype=torch.float64)[:, None]
    x = torch.arange(valid.shape[1], dtype=torch.float64)[None, :]
    draws = torch.rand(count, 6, generator=generator, dtype=torch.float64).tolist()
    for i, (place, size, shape, turn, factor, sign) in enumerate(draws if len(candidates) else ()):
        center_y, center_x = candidates[int(place * len(candidates))].tolist()
        area = _PATCH_PX[0] * (_PATCH_PX[1] / _PATCH_PX[0]) ** size
        aspect, angle = 1 + 2 * shape, math.pi * turn
        along = (x - center_x) * math.cos(angle) + (y - center_y) * math.sin(angle)
        across = (y - center_y) * math.cos(angle) - (x - center_x) * math.sin(angle)
        inside = valid & (along**2 / aspect + across**2 * aspect <= area / math.pi)
        low, high = _PATCH_LOG
        ratio = math.exp((low + (high - low) * factor) * (1 if sign < 0.5 else -1))
        base = depth if i % 2 == 0 else depth[inside].median().expand_as(depth)
        depth = torch.where(inside, base * ratio, depth)
    return replace(frame, sparse_depth=depth).keep(valid)


def _way_within(area: NDArray[np.bool_], start: int) -> NDArray[np.float64]:
    """Length [px] of the shortest way from the flat index `start` to each pixel, inside `area`.

    Ways go from pixel to pixel along rows, columns and diagonals. Infinite where none leads.
    """
    index = np.arange(area.size).reshape(area.shape)
    ways = []
    for here, there, down, right in neighbouring(*area.shape):
        both = area[here] & area[there]
        ways.append((index[here][both], index[there][both], math.hypot(down, right)))
    lengths = np.concatenate([np.full(len(first), length) for first, _, length in ways])
    ends = tuple(np.concatenate(side) for side in zip(*((a, b) for a, b, _ in ways), strict=True))
    graph = coo_array((lengths, ends), shape=(area.size, area.size)).tocsr()
    return np.asarray(dijkstra(graph, directed=False, indices=start))
