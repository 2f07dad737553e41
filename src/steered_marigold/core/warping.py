"""What one frame of a video knows, moved into a later one: by the camera's motion or by flow."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.geometry import project, unproject
from steered_marigold.core.registration import Registration

# a point so much farther than one that lands beside it is seen through a crack of its surface
_SEE_THROUGH = 1.05


def warp_depth(
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    K: Float[Tensor, "3 3"],
    motion: Float[Tensor, "4 4"],
) -> Registration:
    """Depth [m] of an earlier frame as a camera that has moved sees it.

    K: [px], of both frames. motion: points of the earlier camera frame [m] to the present one.
    Each pixel lands on the nearest one; where several meet the nearest to the camera wins, and
    nothing is blended or filled in. What shows through the cracks of a nearer surface is left out.
    """
    points = unproject(depth, K) @ motion[:3, :3].to(depth).T + motion[:3, 3].to(depth)
    in_front = valid_mask & (points[..., 2] > 0)
    safe = torch.where(in_front[..., None], points, torch.ones_like(points))
    return _land(project(safe, K), points[..., 2], in_front)


def warp_by_flow(
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    flow: Float[Tensor, "height width 2"],
) -> Registration:
    """Depth [m] of an earlier frame moved along the flow (x, y) [px] to the present one.

    Depth itself is taken to stay the same; otherwise as `warp_depth`.
    """
    height, width = depth.shape
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    targets = torch.stack((x, y), dim=-1).to(flow) + flow
    return _land(targets, depth, valid_mask & flow.isfinite().all(dim=-1))


def _land(
    targets: Float[Tensor, "height width 2"],
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> Registration:
    """Pixels with a depth [m] at their nearest targets (x, y) [px]; the smallest depth wins."""
    height, width = depth.shape
    x, y = (
        targets.nan_to_num(-1.0, -1.0, -1.0).round().clamp(-1, max(height, width)).long().unbind(-1)
    )
    inside = valid_mask & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    indices = inside.flatten().nonzero().squeeze(1)
    cells = (y * width + x).flatten()[indices]
    values = depth.flatten()[indices]

    nearest = values.new_full((height * width,), torch.inf)
    nearest.scatter_reduce_(0, cells, values, "amin")
    winners = values == nearest[cells]
    source = indices.new_full((height * width,), depth.numel())
    source.scatter_reduce_(0, cells[winners], indices[winners], "amin")

    front = nearest.reshape(1, 1, height, width)
    closest_around = -F.max_pool2d(-front, 3, stride=1, padding=1)
    hit = (source < depth.numel()).reshape(height, width)
    hit &= (front <= closest_around * _SEE_THROUGH)[0, 0]
    return Registration(
        depth=torch.where(hit, nearest.reshape(height, width), torch.zeros_like(depth)),
        valid_mask=hit,
        source=torch.where(hit, source.reshape(height, width), 0),
    )
