"""The pre-processing of BP-Net: a first dense depth, propagated from the nearest measurements."""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from scipy.spatial import cKDTree
from torch import Tensor, nn
from torch.nn import functional as F

from steered_marigold.errors import NoMeasurementsError
from steered_marigold.methods.bpnet.layers import conv_unit, named

# in the units the network was trained in; smaller depths count as not measured
MIN_DEPTH = 1e-3
NEIGHBOURS = 4


def nearest_measured(
    measured: Bool[Tensor, "height width"],
) -> tuple[Int64[Tensor, "4 pixels"], Float[Tensor, "2 4 pixels"]]:
    """The four nearest measured pixels of every pixel, itself included.

    Returns their row-major indices and their offsets (x, y) [px] from the pixel. Among equally
    near ones the last in row-major order come first, as in the published kernel. With fewer than
    four measured pixels the farthest is repeated.

    Raises NoMeasurementsError if nothing is measured.
    """
    height, width = measured.shape
    rows, columns = np.nonzero(measured.numpy(force=True))
    if not rows.size:
        raise NoMeasurementsError(f"bpnet: no measured depth is above {MIN_DEPTH}")
    y, x = (axis.ravel() for axis in np.indices(measured.shape))
    # squared distances are integers: a nudge of the query to the right, and a larger one down, far
    # too small to change their order, settles ties as wanted
    down = 1 / (8 * max(height, width))
    right = down / (4 * max(height, width))
    tree = cKDTree(np.column_stack((columns, rows)))
    ranks = range(1, min(NEIGHBOURS, rows.size) + 1)
    _, nearest = tree.query(np.column_stack((x + right, y + down)), k=list(ranks))
    nearest = np.pad(nearest, ((0, 0), (0, NEIGHBOURS - len(ranks))), mode="edge").T
    indices = rows[nearest] * width + columns[nearest]
    offsets = np.stack((columns[nearest] - x, rows[nearest] - y)).astype(np.float32)
    return (
        torch.from_numpy(indices).to(measured.device),
        torch.from_numpy(offsets).to(measured.device),
    )


class WeightedPool(nn.Module):
    """Sparse depth at 1 / 2^level of its size: averages with softmax weights from the features."""

    def __init__(self, channels: int, level: int) -> None:
        super().__init__()
        self.side = 2**level
        self.permute = named(
            conv=nn.Sequential(
                conv_unit(channels, channels, size=1),
                conv_unit(channels, channels, size=1),
                nn.Conv2d(channels, self.side**2, 1),
            )
        )

    def forward(
        self,
        sparse_depth: Float[Tensor, "batch 1 height width"],
        features: Float[Tensor, "batch channels low_height low_width"],
    ) -> Float[Tensor, "batch 1 low_height low_width"]:
        measured = sparse_depth > MIN_DEPTH
        logits = F.pixel_shuffle(self.permute(features), self.side)
        highest = F.max_pool2d(logits.detach().masked_fill(~measured, -torch.inf), self.side)
        highest = F.interpolate(highest, scale_factor=self.side)
        weights = torch.where(measured, logits - highest, -torch.inf).exp()
        total = F.avg_pool2d(sparse_depth * weights, self.side)
        return total / (F.avg_pool2d(weights, self.side) + 1e-6)


class BilateralPropagation(nn.Module):
    """Depth as the sum over four measured neighbours of omega * (alpha * d + beta).

    alpha, beta and omega come from a perceptron on both pixels' features, the neighbour's 3D point
    and its offset.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()

        def unit(inputs: int, act: nn.Module) -> nn.Sequential:
            return conv_unit(inputs, channels, size=1, act=act)

        self.convXF = nn.Sequential(
            unit(2 * channels + 3 + 2, nn.GELU()), unit(channels, nn.GELU())
        )
        self.convXL = nn.Sequential(unit(channels, nn.GELU()), unit(channels, nn.Identity()))
        self.coef = named(conv=nn.Conv2d(channels, 3, 1))

    def forward(
        self,
        features: Float[Tensor, "batch channels height width"],
        points: Float[Tensor, "batch 3 height width"],
    ) -> Float[Tensor, "batch 1 height width"]:
        """points: the measured pixels' points in the camera frame; z = 0 where unmeasured."""
        found = [nearest_measured(depth > MIN_DEPTH) for depth in points[:, 2]]
        indices, offsets = (torch.stack(parts) for parts in zip(*found, strict=True))
        source = torch.cat((features, points), dim=1).flatten(2)
        index = indices.flatten(1)[:, None].expand(-1, source.shape[1], -1)
        neighbours = torch.unflatten(source.gather(2, index), 2, (NEIGHBOURS, -1))
        own = features.flatten(2)[:, :, None].expand(-1, -1, NEIGHBOURS, -1)
        hidden = self.convXF(torch.cat((own, neighbours, offsets), dim=1))
        hidden = F.gelu(hidden + self.convXL(hidden))
        alpha, beta, omega = self.coef(hidden).chunk(3, dim=1)
        candidates = (alpha + 1) * neighbours[:, -1:] + beta
        depth = (candidates * omega.softmax(dim=2)).sum(dim=2)
        return torch.unflatten(depth, 2, features.shape[2:])
