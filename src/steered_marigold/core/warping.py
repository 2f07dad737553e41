"""What one frame of a video knows, moved into a later one: by the camera's motion or by flow."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.registration import (
    Registration,
    nearest_of_each,
    register_depth_camera,
    without_hidden,
)


def warp_depth(
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    K: Float[Tensor, "3 3"],
    motion: Float[Tensor, "4 4"],
) -> Registration:
    """Depth [m] of an earlier frame as the camera sees it after it has moved.

    K: [px], of both frames. motion: points of the earlier camera frame [m] to the present one.
    It is registered as another camera's; see `register_depth_camera`, which it raises like.
    """
    size = (depth.shape[0], depth.shape[1])
    return register_depth_camera(
        depth, valid_mask, depth_K=K, image_K=K, extrinsics=motion, size=size
    )


def warp_by_flow(
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    flow: Float[Tensor, "height width 2"],
) -> Registration:
    """Depth [m] of an earlier frame moved along the flow (x, y) [px], each to the nearest pixel.

    Depth itself is taken to stay the same. Where several meet the smallest depth wins, nothing is
    blended, and what a nearer surface hides is left out.
    """
    height, width = depth.shape
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    places = (torch.stack((x, y), dim=-1) + flow).round()
    inside = valid_mask & (places >= 0).all(dim=-1)  # False where the flow is no number
    inside &= (places < torch.tensor([width, height])).all(dim=-1)
    indices = inside.flatten().nonzero().squeeze(1)
    columns, rows = places.reshape(-1, 2)[indices].long().unbind(dim=-1)
    values = depth.flatten()[indices]
    landed = nearest_of_each(depth, indices, rows * width + columns, values, (height, width))
    return without_hidden(landed)
