"""Numbers in a depth map that are no depths: fills, sentinels, absurd values.

What can be said before any prediction. What looks like depth and contradicts the image is the
business of `outliers`.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.thinning import thinned

NEAREST, FARTHEST = 0.001, 1e5  # [m]; nothing beyond is depth
# with fewer measurements nothing can be said of any of them
LEAST_MEASUREMENTS = 20
# A fill is one value at so many pixels, FAR_FACTOR times farther (or nearer) than all others but
# the last hundredth; or FILL_FACTOR times farther, if it is so much more frequent than any other
# value: a wall at the end of a corridor, in a file of few steps, is neither. A box before
# everything else, parallel to the image, is one value as well: nearer takes FAR_FACTOR.
FILL_PIXELS = 50
FAR_FACTOR = 5.0
FILL_FACTOR = 1.5
FILL_FREQUENCY = 3.0
# where most measurements have the value it is a wall, unless it is so many times farther
MAJORITY_FACTOR = 20.0
# farther than this many times what nine in ten reach, or nearer likewise, is no depth of the same
# scene: LiDAR from 2 to 100 m and a hand at 10 cm before a wall at 5 m are within it
ABSURD_FACTOR = 50.0


@dataclass(frozen=True)
class Plausibility:
    """mask: what counts as measured. beyond_limits: pixels nearer than NEAREST, or farther than
    FARTHEST. repeated: pixels of fills. absurd: pixels out of all range. fills: the values [m] of
    the fills.
    """

    mask: Bool[Tensor, "height width"]
    beyond_limits: int
    repeated: int
    absurd: int
    fills: tuple[float, ...]


def plausible_measurements(
    sparse_depth: Float[Tensor, "height width"], valid_mask: Bool[Tensor, "height width"]
) -> Plausibility:
    """Which measurements [m] can be depths of one scene, by their values alone.

    Not so are one and the same extreme value at many pixels, whatever the type of the file (65535
    in 32 bits, FLT_MAX, 65504, 1e10, 0.001), and values far outside what all others span.
    Within the limits, multiplying all depth by a number changes nothing.
    """
    depth = sparse_depth[valid_mask].cpu().numpy()
    keep = (depth >= np.float32(NEAREST)) & (depth <= FARTHEST)
    beyond = int(np.count_nonzero(~keep))
    fills: list[float] = []
    while (fill := _fill(depth[keep])) is not None:
        fills.append(fill)
        keep &= depth != fill
    repeated = int(np.count_nonzero(~keep)) - beyond
    if np.count_nonzero(keep) >= LEAST_MEASUREMENTS:
        near, far = np.quantile(thinned(depth[keep]), (0.1, 0.9))
        keep &= (depth <= far * ABSURD_FACTOR) & (depth >= near / ABSURD_FACTOR)
    mask = valid_mask.clone()
    mask[valid_mask] = torch.from_numpy(keep).to(mask.device)
    absurd = int(np.count_nonzero(~keep)) - repeated - beyond
    return Plausibility(mask, beyond, repeated, absurd, tuple(fills))


def _fill(depth: NDArray[np.float32]) -> float | None:
    """The least or greatest value, if it is a fill."""
    if len(depth) < LEAST_MEASUREMENTS:
        return None
    for extreme in (depth.max(), depth.min()):
        is_extreme = depth == extreme
        count = np.count_nonzero(is_extreme)
        if count < FILL_PIXELS or len(depth) - count < LEAST_MEASUREMENTS:
            continue
        others = thinned(depth[~is_extreme]).astype(np.float64)
        near, far = np.quantile(others, (0.01, 0.99))
        beyond = max(extreme / far, near / extreme)
        frequency = np.unique(others, return_counts=True)[1].max() * (len(depth) - count)
        frequent = count * len(others) > FILL_FREQUENCY * frequency
        if 2 * count > len(depth):
            is_fill = beyond > MAJORITY_FACTOR
        else:
            is_fill = beyond > FAR_FACTOR or (extreme > FILL_FACTOR * far and frequent)
        if is_fill:
            return float(extreme)
    return None
