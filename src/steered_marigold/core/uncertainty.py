"""How sure the answer is, in metres, calibrated on development frames."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.consistency import SensorNoise


@dataclass(frozen=True)
class UncertaintyModel:
    """sigma^2 = noise^2 + (depth (near + reach far))^2 + (spread members far)^2,
    far = 1 - exp(-distance / length).

    near: relative error beside a measurement. reach: what is added far from all of them, times
    the relative disagreement of prior and measurements. length [share of the image's diagonal].
    spread: factor on the ensemble members' median absolute deviation.
    """

    near: float
    reach: float
    length: float
    spread: float


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

    prior, depth: metric depth before and after it was made to agree with the measurements.
    spread: median absolute deviation of the members [m], or None with one member.
    """
    distance = torch.from_numpy(ndimage.distance_transform_edt(~trusted.cpu().numpy()))
    height, width = depth.shape
    share = distance.to(depth) / (height**2 + width**2) ** 0.5
    far = 1 - torch.exp(-share / model.length)
    disagreement = (sparse_depth[trusted].log() - prior[trusted].log()).square().mean().sqrt()
    # a handful of measurements can agree with the fit by construction
    disagreement = disagreement.clamp(min=0.05) if bool(trusted.any()) else torch.tensor(0.3)
    relative = model.near * (distance > 0).to(depth) + model.reach * disagreement * far
    variance = (depth * relative).square() + (depth * noise.relative(depth)).square()
    if spread is not None:
        variance = variance + (model.spread * spread * far).square()
    return variance.sqrt()
