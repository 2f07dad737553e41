"""Where nothing was measured, and whether that is because a sensor's range ends."""

import math
from dataclasses import dataclass
from enum import IntEnum

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from steered_marigold.core.distance import distance_to
from steered_marigold.core.thinning import thinned

# the measured range is that of all measurements but so many at both ends
RANGE_TAILS = 0.02
# A sensor has a range if, of what is DEEP (a share of the diagonal) in holes, so much lies beyond
# the measured range, and next to nothing within it, both clearly (in log depth): true of four in
# five tune frames whose depth is cut by distance, and of one in fifteen that are cut elsewhere.
BEYOND, BEYOND_SHARE = 0.05, 0.4
CLEARLY, WITHIN_SHARE = 0.2, 0.1
DEEP = 0.03
BLOCKS = 16  # of an image's height, and of its width; finer ones miss the rows of sparse samples
# Of such an image's holes so many are there because the range ends, and so far is a prior's log
# depth off there. Chosen on the tune frames.
BECAUSE_OF_RANGE = 0.9
PRIOR_ERROR = 0.12
# so near to a measurement (a share of the diagonal) shadows, edges and speckle are why
SHALLOW = 0.01
# distances are taken in blocks of this side (a share of the diagonal), and interpolated
DISTANCE_STEP = 0.005


class Hole(IntEnum):
    """Where a pixel lies. INSIDE: between measurements in its row or column of BLOCKS. BESIDE: not.

    FARTHER, NEARER: in an image that the sensor's range cuts there.
    """

    INSIDE = 0
    BESIDE = 1
    FARTHER = 2
    NEARER = 3


@dataclass(frozen=True)
class Holes:
    """distance: to the nearest trusted measurement, as a share of the image's diagonal.

    kind: of `Hole`. cut: FARTHER or NEARER where that is the kind of all pixels, else None. low,
    high: logarithms of the measured range.
    """

    distance: Float[Tensor, "height width"]
    kind: Int[Tensor, "height width"]
    cut: Hole | None
    low: Float[Tensor, ""]
    high: Float[Tensor, ""]

    def beyond(
        self, log_depth: Float[Tensor, "height width"]
    ) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
        """How far it lies beyond the far end of the measured range, and the near end; else 0."""
        return (log_depth - self.high).clamp(min=0), (self.low - log_depth).clamp(min=0)


def find_holes(
    prior: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
) -> Holes:
    """Of each pixel; prior: metric depth of the image. At least one measurement is trusted."""
    diagonal = math.hypot(*trusted.shape)
    step = max(1, round(diagonal * DISTANCE_STEP))
    distance = distance_to(trusted, cap=math.ceil(diagonal), step=step) / diagonal
    measured = sparse_depth[trusted].log()
    low, high = thinned(measured).quantile(measured.new_tensor((RANGE_TAILS, 1 - RANGE_TAILS)))
    deep = prior[distance > DEEP].log()
    cut = Hole.FARTHER if _is_cut(deep - high) else Hole.NEARER if _is_cut(low - deep) else None
    if cut is not None:
        kind = torch.full_like(trusted, int(cut), dtype=torch.long)
    else:
        kind = torch.where(_between(trusted), int(Hole.INSIDE), int(Hole.BESIDE))
    return Holes(distance, kind, cut, low, high)


def expect_beyond(prior: Float[Tensor, "height width"], holes: Holes) -> Tensor:
    """The prior, knowing that where a sensor's range ends what is missing lies beyond it.

    Let log depth be normal around the prior's, with PRIOR_ERROR. Where the range is why a pixel is
    missing, log depth is truncated at the range's end, and its mean (Johnson, Kotz and
    Balakrishnan 1994, section 13.10.1) is

        log prior + PRIOR_ERROR phi(z) / Phi(-z),   z = (end - log prior) / PRIOR_ERROR,

    which moves a prior near the end, and hardly one far beyond it. How probable the range is as
    the reason is Bayes' rule from BECAUSE_OF_RANGE, with Phi(-z): a prior clearly within
    the range stays.
    """
    if holes.cut is None:
        return prior
    side, end = (1, holes.high) if holes.cut == Hole.FARTHER else (-1, holes.low)
    z = side * (end - prior.log()) / PRIOR_ERROR
    tail = torch.special.ndtr(-z)
    reason = BECAUSE_OF_RANGE * tail / (BECAUSE_OF_RANGE * tail + 1 - BECAUSE_OF_RANGE)
    hazard = torch.exp(-z.square() / 2 - torch.special.log_ndtr(-z)) / math.sqrt(2 * math.pi)
    moved = prior * torch.exp(side * PRIOR_ERROR * reason * hazard)
    return torch.where(holes.distance > SHALLOW, moved, prior)


def _is_cut(beyond: Float[Tensor, " n"]) -> bool:
    """beyond: how far log depth of pixels deep in holes lies beyond an end of the range."""
    if len(beyond) == 0:
        return False
    outside, within = (x.float().mean() for x in (beyond > BEYOND, beyond < -CLEARLY))
    return bool((outside > BEYOND_SHARE) & (within < WITHIN_SHARE))


def _between(trusted: Bool[Tensor, "height width"]) -> Bool[Tensor, "height width"]:
    """Whether there are measurements on both sides, in a pixel's row or column of BLOCKS."""
    seen = F.adaptive_max_pool2d(trusted.float()[None], BLOCKS)[0]
    across, along = (
        seen.cummax(dim).values * seen.flip(dim).cummax(dim).values.flip(dim) for dim in (1, 0)
    )
    between = torch.maximum(across, along)[None, None]
    return F.interpolate(between, size=trusted.shape, mode="nearest")[0, 0] > 0
