"""How sure the answer is, in metres, calibrated on development frames by kind of hole."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.holes import Holes

# what a sensor's depth is worth where nobody says, next to the steps of its file: structured light
# and time of flight reach 0.2 % of depth at their best
DEFAULT_NOISE = SensorNoise(fraction=0.002)
# side of the window of `steps`, as a share of the image's diagonal
STEPS_WINDOW = 0.04
# what is expected of a prior before anything is measured, and how many measurements that is worth
EXPECTED_DISAGREEMENT = 0.2
EXPECTED_WEIGHT = 3.0


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
    """What an error depends on; the terms of `UncertaintyModel`. distance, kind: of `Holes`."""

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
    holes: Holes,
    doubt: Float[Tensor, "height width"] | None,
) -> Circumstances:
    """Of each pixel of an answer; arguments as `estimate_uncertainty`."""
    height, width = depth.shape
    diagonal = (height**2 + width**2) ** 0.5
    measured, log_depth, log_prior = sparse_depth[trusted].log(), depth.log(), prior.log()
    squares = (measured - log_prior[trusted]).square()
    expected = EXPECTED_WEIGHT * EXPECTED_DISAGREEMENT**2
    farther, nearer = holes.beyond(log_depth)
    return Circumstances(
        distance=holes.distance,
        kind=holes.kind,
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
    holes: Holes,
    doubt: Float[Tensor, "height width"] | None,
    noise: SensorNoise,
) -> Float[Tensor, "height width"]:
    """Standard deviation [m] of each pixel's error; at measurements that of the sensor.

    prior, depth: metric depth before and after it was made to agree with the measurements, of
    which there is at least one trusted. holes: by these measurements. doubt: of the prior's log
    depth for want of its origin. noise: the sensor's, not 0. Multiplying prior, depth and
    measurements by a number multiplies the result by it, if the noise is a fraction of depth.
    """
    around = circumstances(prior, depth, sparse_depth, trusted, holes, doubt)
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


def mean_steps(
    values: Float[Tensor, "height width"], *, radius: int
) -> Float[Tensor, "height width"]:
    """Mean over a window of the differences to the right and the lower neighbour, absolute."""
    steps = F.pad(values.diff(dim=1).abs(), (0, 1)) + F.pad(values.diff(dim=0).abs(), (0, 0, 0, 1))
    side = 2 * radius + 1
    share = [
        ndimage.uniform_filter1d(np.ones(n, np.float32), side, mode="constant")
        for n in values.shape
    ]
    mean = ndimage.uniform_filter(steps.cpu().numpy(), side, mode="constant")
    return torch.from_numpy(mean / np.multiply.outer(*share)).to(values)
