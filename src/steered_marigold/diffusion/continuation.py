"""The second pass: the measurements, told as clean latents to a U-Net that continues them."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.continuation import known_cells, told_depth
from steered_marigold.core.finishing import median
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.grid import Measured, Views


@dataclass(frozen=True)
class Told:
    """Clean depth latents where `known`."""

    latents: Float[Tensor, "batch channels h w"]
    known: Bool[Tensor, "batch 1 h w"]


def tell(
    views: Views, measured: Measured, estimate: Float[Tensor, "answers h w"], codec: DepthCodec
) -> Told:
    """The measurements as latents, in the units of a first estimate, for every member.

    measured: of the images. estimate: decoded depth in [-1, 1] of every answer, on the grid.
    """
    on_grid = views.on_grid(measured)
    maps, trusted = [], []
    for members, depth, mask in zip(
        torch.split(estimate.float(), views.members),
        on_grid.sparse_depth,
        on_grid.valid_mask,
        strict=True,
    ):
        told, believed = told_depth(median(members), depth.to(members), mask.to(members.device))
        maps.append(told)
        trusted.append(believed)
    latents = codec.encode(torch.stack(maps))
    cell = estimate.shape[-1] // latents.shape[-1]
    known = torch.stack([known_cells(mask, cell) for mask in trusted])[:, None]
    latents, known = (x.repeat_interleave(views.members, dim=0) for x in (latents, known))
    return Told(latents, known)
