"""The refinement of BP-Net: spatial propagation with kernels of three sizes.

Cheng et al., "CSPN++: Learning Context and Resource Aware Convolutional Spatial Propagation
Networks for Depth Completion", AAAI 2020.
"""

from math import isqrt

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from steered_marigold.methods.bpnet.layers import conv_unit
from steered_marigold.methods.bpnet.preprocessing import MIN_DEPTH


def local_convolution(
    depth: Float[Tensor, "batch 1 height width"],
    kernels: Float[Tensor, "batch taps height width"],
) -> Float[Tensor, "batch 1 height width"]:
    """Convolution with a kernel of its own at every pixel, row-major, zero outside the image."""
    side = isqrt(kernels.shape[1])
    patches = F.unfold(depth, side, padding=side // 2).view_as(kernels)
    return (patches * kernels).sum(dim=1, keepdim=True)


class KernelGenerator(nn.Module):
    """Kernels of side x side whose weights sum to 1, and those off the centre, in size, to 1."""

    def __init__(self, channels: int, side: int) -> None:
        super().__init__()
        self.conv = nn.Sequential(
            conv_unit(channels, channels), conv_unit(channels, side**2 - 1, act=nn.Identity())
        )

    def forward(
        self, features: Float[Tensor, "batch channels height width"]
    ) -> Float[Tensor, "batch taps height width"]:
        around = self.conv(features)
        around = around / (around.abs().sum(dim=1, keepdim=True) + 1e-6)
        before, after = around.chunk(2, dim=1)
        return torch.cat((before, 1 - around.sum(dim=1, keepdim=True), after), dim=1)


class Refinement(nn.Module):
    """CSPN++: propagates with 3x3, 5x5 and 7x7 kernels and mixes what they give.

    steps: an even number of propagations; the start, the middle and the end are mixed.
    """

    def __init__(self, channels: int, *, steps: int) -> None:
        super().__init__()
        self.steps = steps
        self.weight3x3 = KernelGenerator(channels, 3)
        self.weight5x5 = KernelGenerator(channels, 5)
        self.weight7x7 = KernelGenerator(channels, 7)

        def head(inputs: int, act: nn.Module) -> nn.Sequential:
            last = conv_unit(channels, 3, norm=False, act=act)
            return nn.Sequential(conv_unit(inputs, channels), last)

        self.convmask = head(channels, nn.Sigmoid())
        self.convck = head(channels, nn.Softmax(dim=1))
        self.convct = head(channels + 3, nn.Softmax(dim=1))

    def forward(
        self,
        features: Float[Tensor, "batch channels height width"],
        depth: Float[Tensor, "batch 1 height width"],
        sparse_depth: Float[Tensor, "batch 1 height width"],
    ) -> Float[Tensor, "batch 1 height width"]:
        kernels = [weight(features) for weight in (self.weight3x3, self.weight5x5, self.weight7x7)]
        # how far each kernel size holds measured pixels at their measurement
        hold = self.convmask(features) * (sparse_depth > MIN_DEPTH)
        share_of_size = self.convck(features)
        propagated = depth.expand(-1, 3, -1, -1)
        stages = [depth]
        for step in range(1, self.steps + 1):
            moved = [
                local_convolution(*pair)
                for pair in zip(propagated.chunk(3, dim=1), kernels, strict=True)
            ]
            propagated = (1 - hold) * torch.cat(moved, dim=1) + hold * sparse_depth
            if step in (self.steps // 2, self.steps):
                stages.append((share_of_size * propagated).sum(dim=1, keepdim=True))
        mixed = torch.cat(stages, dim=1)
        share_of_stage = self.convct(torch.cat((features, mixed), dim=1))
        refined: Tensor = (share_of_stage * mixed).sum(dim=1, keepdim=True)
        return refined
