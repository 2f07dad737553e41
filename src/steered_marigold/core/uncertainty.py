"""How sure the answer is, in metres, calibrated on development frames by kind of hole."""

from dataclasses import dataclass
from enum import IntEnum

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.consistency import SensorNoise

# what a sensor's depth is worth where nobody says, next to the steps of its file: structured light
# and time of flight reach 0.2 % of depth at their best
DEFAULT_NOISE = SensorNoise(fraction=0.002)
# side of the window of `steps`, as a share of the image's diagonal
STEPS_WINDOW = 0.04
# what is expected of a prior before anything is measured, and how many measurements that is worth
EXPECTED_DISAGREEMENT = 0.2
EXPECTED_WEIGHT = 3.0
# the measured range is that of all measurements but so many at both ends
RANGE_TAILS = 0.02
SAMPLE = 20_000  # measurements that tell the range, evenly spread
# so much of what is DEEP (a share of the diagonal) in holes lies beyond the measured range: the
# sensor has a range. On the tune frames .4 to .6 do where depth is cut by distance, .0 to .1 where
# it is cut elsewhere
BEYOND_SHARE = 0.3
DEEP = 0.03
BLOCKS = 16  # of an image's height, and of its width; finer ones miss the rows of sparse samples


class Hole(IntEnum):
    """Where a pixel lies. INSIDE: between measurements in its row or column of BLOCKS. BESIDE: not.

    FARTHER, NEARER: in an image whose holes lie beyond the measured range.
    """

    INSIDE = 0
    BESIDE = 1
    FARTHER = 2
    NEARER = 3


@dataclass(frozen=True)
class UncertaintyModel:
    """sigma^2 = sensor^2 + depth^2 by_kind^2 (near^2 + far ((reach D)^2 + (drift distance)^2
    + (origin doubt)^2 + (moved |log depth - log prior|)^2 + (farther f)^2 + (nearer n)^2)
    + far^2 (relief steps)^2),

    far = 1 - exp(-(distance / length)^1.5).

    D is the relative disagreement (root mean square) of the prior with the trusted measurements
    and with `EXPECTED_WEIGHT` imagined ones, which disagree by `EXPECTED_DISAGREEMENT`: a fit
    agrees with a handful of measurements, whatever it is worth elsewhere. doubt: of log depth, for
    want of the origin (`PositiveFit.doubt`). f, n: how far log depth lies beyond the measured
    range. steps: mean difference of the prior's log depth between neighbours around a pixel: where
    depth jumps, it jumps elsewhere.

    near: relative error beside a measurement. distance, length: shares of the image's diagonal.
    by_kind: a factor for each kind of `Hole`, such that 90 % of the errors on the tune frames lie
    within the 90 % interval.
    """

    near: float
    reach: float
    drift: float
    length: float
    origin: float
    moved: float
    farther: float
    nearer: float
    relief: float
    by_kind: tuple[float, float, float, float]


@dataclass(frozen=True)
class Circumstances:
    """What an error depends on; the terms of `UncertaintyModel`.

    distance: to the nearest trusted measurement, as a share of the image's diagonal. kind: of
    `Hole`.
    """

    distance: Float[Tensor, "height width"]
    kind: Int[Tensor, "height width"]
    disagreement: Float[Tensor, ""]
    doubt: Float[Tensor, "height width"]
    moved: Float[Tensor, "height width"]
    farther: Float[Tensor, "height width"]
    nearer: Float[Tensor, "height width"]
    steps: Float[Tensor, "height width"]


def circumstances(
    prior: Float[Tensor, "height width"],
    depth: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
    doubt: Float[Tensor, "height width"] | None,
) -> Circumstances:
    """Of each pixel of an answer; arguments as `estimate_uncertainty`."""
    height, width = depth.shape
    diagonal = (height**2 + width**2) ** 0.5
    pixels = ndimage.distance_transform_edt(~trusted.cpu().numpy())
    distance = torch.from_numpy(pixels).to(depth) / diagonal
    measured, log_depth, log_prior = sparse_depth[trusted].log(), depth.log(), prior.log()
    squares = (measured - log_prior[trusted]).square()
    expected = EXPECTED_WEIGHT * EXPECTED_DISAGREEMENT**2
    low, high = measured[:: -(-len(measured) // SAMPLE)].quantile(
        measured.new_tensor((RANGE_TAILS, 1 - RANGE_TAILS))
    )
    farther, nearer = (log_depth - high).clamp(min=0), (low - log_depth).clamp(min=0)
    return Circumstances(
        distance=distance,
        kind=_kinds(trusted, distance > DEEP, farther, nearer),
        disagreement=((squares.sum() + expected) / (len(squares) + EXPECTED_WEIGHT)).sqrt(),
        doubt=torch.zeros_like(depth) if doubt is None else doubt,
        moved=(log_depth - log_prior).abs(),
        farther=farther,
        nearer=nearer,
        steps=mean_steps(log_prior, radius=round(STEPS_WINDOW * diagonal / 2)),
    )


def estimate_uncertainty(
    model: UncertaintyModel,
    prior: Float[Tensor, "height width"],
    depth: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
    doubt: Float[Tensor, "height width"] | None,
    noise: SensorNoise,
) -> Float[Tensor, "height width"]:
    """Standard deviation [m] of each pixel's error; at measurements that of the sensor.

    prior, depth: metric depth before and after it was made to agree with the measurements, of
    which there is at least one trusted. doubt: of the prior's log depth for want of its origin.
    noise: the sensor's, not 0. Multiplying prior, depth and measurements by a number multiplies the
    result by it, if the noise is a fraction of depth.
    """
    around = circumstances(prior, depth, sparse_depth, trusted, doubt)
    relative = relative_uncertainty(model, around) * (~trusted)
    sensor = noise.relative(depth)
    return depth * (relative.square() + sensor.square()).sqrt()


def relative_uncertainty(
    model: UncertaintyModel, around: Circumstances
) -> Float[Tensor, "height width"]:
    """The standard deviation of the error as a share of depth, the sensor's apart."""
    far = 1 - torch.exp(-((around.distance / model.length) ** 1.5))
    reach = (
        (model.reach * around.disagreement).square()
        + (model.drift * around.distance).square()
        + (model.origin * around.doubt).square()
        + (model.moved * around.moved).square()
        + (model.farther * around.farther).square()
        + (model.nearer * around.nearer).square()
    )
    relief = (model.relief * around.steps * far).square()
    factor = far.new_tensor(model.by_kind)[around.kind]
    return factor * (model.near**2 + far * reach + relief).sqrt()


def _kinds(
    trusted: Bool[Tensor, "height width"],
    deep: Bool[Tensor, "height width"],
    farther: Float[Tensor, "height width"],
    nearer: Float[Tensor, "height width"],
) -> Int[Tensor, "height width"]:
    """The kind of `Hole` of each pixel. deep: far from measurements."""
    if bool(deep.any()):
        shares = [float((beyond[deep] > 0).float().mean()) for beyond in (farther, nearer)]
        if max(shares) > BEYOND_SHARE:
            kind = Hole.FARTHER if shares[0] >= shares[1] else Hole.NEARER
            return torch.full_like(trusted, int(kind), dtype=torch.long)
    seen = F.adaptive_max_pool2d(trusted.float()[None], BLOCKS)[0]
    across, along = (
        seen.cummax(dim).values * seen.flip(dim).cummax(dim).values.flip(dim) for dim in (1, 0)
    )
    between = torch.maximum(across, along)[None, None]
    height, width = trusted.shape
    inside = F.interpolate(between, size=(height, width), mode="nearest")[0, 0] > 0
    return torch.where(inside, int(Hole.INSIDE), int(Hole.BESIDE))


def mean_steps(
    values: Float[Tensor, "height width"], *, radius: int
) -> Float[Tensor, "height width"]:
    """Mean over a window of the differences to the right and the lower neighbour, absolute."""
    right = F.pad(values.diff(dim=1).abs(), (0, 1))
    down = F.pad(values.diff(dim=0).abs(), (0, 0, 0, 1))
    maps = (right + down)[None, None]
    for kernel, padding in (((2 * radius + 1, 1), (radius, 0)), ((1, 2 * radius + 1), (0, radius))):
        maps = F.avg_pool2d(maps, kernel, stride=1, padding=padding, count_include_pad=False)
    return maps[0, 0]
