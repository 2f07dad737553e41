"""How sure the answer is, in metres, calibrated on development frames."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.consistency import SensorNoise


@dataclass(frozen=True)
class UncertaintyModel:
    """sigma^2 = sensor^2 + depth^2 (near + reach D far leverage)^2 + (spread members far)^2
    + (relief steps depth far)^2, where far = 1 - exp(-(distance / length)^1.5) and
    leverage^2 = 1 + extrapolation (log depth - mean)^2 / (variance + `LEAST_VARIANCE`).

    D is the relative disagreement (root mean square) of the prior with the trusted measurements
    and with `EXPECTED_WEIGHT` imagined ones, which disagree by `EXPECTED_DISAGREEMENT`: a fit
    agrees with a handful of measurements, whatever it is worth elsewhere.
    mean, variance: of the log of the trusted measurements; away from them a line that was fitted
    to them is less sure, as in any regression.

    near: relative error beside a measurement. reach: factor on D far from all measurements.
    length: where that is reached, as a share of the image's diagonal. spread: factor on the
    ensemble members' median absolute deviation. relief: factor on `steps`, the mean difference of
    the prior's log depth between neighbours around a pixel: where depth jumps, it jumps elsewhere.
    """

    near: float
    reach: float
    length: float
    extrapolation: float
    spread: float
    relief: float


# side of the window of `relief`, as a share of the image's diagonal
RELIEF_WINDOW = 0.04
# what is expected of a prior before anything is measured, and how many measurements that is worth
EXPECTED_DISAGREEMENT = 0.2
EXPECTED_WEIGHT = 3.0
# of log depth; measurements at one depth do not leave every other depth unknown
LEAST_VARIANCE = 0.05


def estimate_uncertainty(
    model: UncertaintyModel,
    prior: Float[Tensor, "height width"],
    depth: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
    spread: Float[Tensor, "height width"] | None,
    noise: SensorNoise,
) -> Float[Tensor, "height width"]:
    """Standard deviation [m] of each pixel's error; at measurements that of the sensor.

    prior, depth: metric depth before and after it was made to agree with the measurements, of
    which there is at least one. spread: median absolute deviation of the members [m], or None
    with one member.
    """
    distance = torch.from_numpy(ndimage.distance_transform_edt(~trusted.cpu().numpy())).to(depth)
    height, width = depth.shape
    diagonal = (height**2 + width**2) ** 0.5
    far = 1 - torch.exp(-((distance / diagonal / model.length) ** 1.5))
    measured = sparse_depth[trusted].log()
    squares = (measured - prior[trusted].log()).square()
    expected = EXPECTED_WEIGHT * EXPECTED_DISAGREEMENT**2
    disagreement = ((squares.sum() + expected) / (len(squares) + EXPECTED_WEIGHT)).sqrt()
    variance_seen = measured.var(correction=0) + LEAST_VARIANCE
    away = (depth.log() - measured.mean()).square() / variance_seen
    leverage = (1 + model.extrapolation * away).sqrt()
    relative = model.near * (distance > 0) + model.reach * disagreement * far * leverage
    variance = (depth * relative).square() + (depth * noise.relative(depth)).square()
    steps = mean_steps(prior.log(), radius=round(RELIEF_WINDOW * diagonal / 2))
    variance = variance + (model.relief * steps * depth * far).square()
    if spread is not None:
        variance = variance + (model.spread * spread * far).square()
    return variance.sqrt()


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
