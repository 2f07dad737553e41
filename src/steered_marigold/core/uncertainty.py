"""How sure the answer is, in metres, calibrated on development frames."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.consistency import SensorNoise


@dataclass(frozen=True)
class UncertaintyModel:
    """sigma^2 = sensor^2 + depth^2 (near + reach D far (1 + extrapolation beyond))^2
    + (spread members far)^2, with far = 1 - exp(-(distance / length)^1.5).

    D is the relative disagreement (root mean square) of the prior with the trusted measurements,
    beyond = max(0, log(depth / deepest measurement)): scale and shift are only fitted so far.

    near: relative error beside a measurement. reach: factor on D far from all measurements.
    length: where that is reached, as a share of the image's diagonal. spread: factor on the
    ensemble members' median absolute deviation.
    """

    near: float
    reach: float
    length: float
    extrapolation: float
    spread: float


# relative disagreement assumed where a handful of measurements agrees with any fit
LEAST_DISAGREEMENT = 0.05


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
    far = 1 - torch.exp(-((distance / (height**2 + width**2) ** 0.5 / model.length) ** 1.5))
    measured = sparse_depth[trusted]
    disagreement = (measured.log() - prior[trusted].log()).square().mean().sqrt()
    beyond = (depth / measured.max()).log().clamp(min=0)
    reach = model.reach * disagreement.clamp(min=LEAST_DISAGREEMENT)
    relative = model.near * (distance > 0) + reach * far * (1 + model.extrapolation * beyond)
    variance = (depth * relative).square() + (depth * noise.relative(depth)).square()
    if spread is not None:
        variance = variance + (model.spread * spread * far).square()
    return variance.sqrt()
