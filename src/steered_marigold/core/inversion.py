"""Depth that may be disparity or inverse depth: its numbers grow towards the viewer."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.notices import Notice, Notices

_WINDOWS_SIZE = 160  # longest side [px] at which planes are looked for
_PER_SIDE = 8  # windows along the longest side
_SLANTED = 1.25  # ratio of the 95 % to the 5 % depth in a window that can tell
_PLANAR = 0.015  # median relative distance from a plane, at most
_ROW_WEIGHT = 6.0
_INVERTED_BELOW = -3.0  # the lowest of 869 real frames is at -2.5


def inversion_doubts(
    depth: Float[Tensor, "height width"], valid_mask: Bool[Tensor, "height width"]
) -> Notices:
    """A notice if the numbers look like disparity or inverse depth.

    The score: 1/z of a plane is affine in the pixel's place and z is not, so windows vote for what
    is closer to affine; and what is lower in an image is mostly nearer.
    """
    step = max(1, max(depth.shape) // _WINDOWS_SIZE)
    z = depth[::step, ::step].cpu().double().numpy()
    valid = valid_mask[::step, ::step].cpu().numpy()
    if _plane_votes(z, valid) - _ROW_WEIGHT * _row_correlation(z, valid) > _INVERTED_BELOW:
        return ()
    text = (
        "The numbers grow towards the viewer, as disparity or inverse depth do: is "
        "`depth_encoding` disparity (with `baseline`) or inverse?"
    )
    return (Notice("looks_inverse", text),)


def _plane_votes(z: NDArray[np.float64], valid: NDArray[np.bool_]) -> float:
    """Sum over slanted, planar windows of log(distance of z / distance of 1/z), each up to 2."""
    size = max(8, max(z.shape) // _PER_SIDE)
    total = 0.0
    for top in range(0, z.shape[0] - size + 1, size // 2):
        for left in range(0, z.shape[1] - size + 1, size // 2):
            window = slice(top, top + size), slice(left, left + size)
            rows, columns = np.nonzero(valid[window])
            if len(rows) < max(40, 0.3 * size**2):
                continue
            values = z[window][rows, columns]
            low, high = np.percentile(values, (5, 95))
            if high < _SLANTED * low:
                continue
            basis = np.stack([rows / size - 0.5, columns / size - 0.5, np.ones(len(rows))], axis=1)
            projector = basis @ np.linalg.solve(basis.T @ basis, basis.T @ _pair(values))
            apart = np.median(np.abs(_pair(values) - projector), axis=0) + 1e-9
            if apart.min() < _PLANAR:
                total += float(np.clip(np.log(apart[0] / apart[1]), -2, 2))
    return total


def _pair(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth and inverse depth, [points, 2], each with mean 1."""
    both = np.stack([values, 1 / values], axis=1)
    return np.asarray(both / both.mean(axis=0))


def _row_correlation(z: NDArray[np.float64], valid: NDArray[np.bool_]) -> float:
    """Rank correlation of depth with the row: negative where lower is nearer."""
    if valid.sum() < 50 or np.ptp(z[valid]) == 0 or np.ptp(np.nonzero(valid)[0]) == 0:
        return 0.0
    return float(np.corrcoef(_ranks(z[valid]), _ranks(np.nonzero(valid)[0]))[0, 1])


def _ranks(values: NDArray[Any]) -> NDArray[np.float64]:
    """Of each value among all; equal ones share the mean of theirs. SciPy's loads half a second."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])
