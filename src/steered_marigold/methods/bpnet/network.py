"""The network of BP-Net, coarse to fine over six scales."""

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from steered_marigold.core.geometry import unproject
from steered_marigold.methods.bpnet.layers import UpConcat, conv_unit
from steered_marigold.methods.bpnet.preprocessing import BilateralPropagation, WeightedPool
from steered_marigold.methods.bpnet.refinement import Refinement
from steered_marigold.methods.residual import residual_stage

LEVELS = 6
MULTIPLE = 2 ** (LEVELS - 1)


class BPNet(nn.Module):
    """Tang et al., "Bilateral Propagation Network for Depth Completion" (arXiv 2403.11270).

    The paper's stochastic depth, a regulariser of training, is left out.

    width: channels at full resolution; the published weights have 32.
    """

    def __init__(self, *, width: int = 32) -> None:
        super().__init__()
        channels = [min(2**level, 8) * width for level in range(LEVELS)]
        full, half, quarter, low, *_ = channels

        self.conv_img = nn.Sequential(conv_unit(3, full), residual_stage(full, full, blocks=2))
        self.layer1_img = residual_stage(full, half, blocks=2, stride=2)
        self.layer2_img = residual_stage(half, quarter, blocks=2, stride=2)
        self.layer3_img = residual_stage(quarter, low, blocks=2, stride=2)
        self.layer4_img = residual_stage(low, low, blocks=2, stride=2)
        self.layer5_img = residual_stage(low, low, blocks=2, stride=2)

        self.pred0 = Scale(0, channels)
        self.pred1 = Scale(1, channels)
        self.pred2 = Scale(2, channels)
        self.pred3 = Scale(3, channels)
        self.pred4 = Scale(4, channels)
        self.pred5 = Scale(5, channels)

    def forward(
        self,
        image: Float[Tensor, "batch 3 height width"],
        sparse_depth: Float[Tensor, "batch 1 height width"],
        K: Float[Tensor, "3 3"],
    ) -> Float[Tensor, "batch 1 height width"]:
        """Dense depth. Height and width must be multiples of 32.

        image: normalised. sparse_depth: 0 where nothing was measured; [m] times the training's
        depth scale, as is the answer. K: one camera for the batch [px].
        """
        features = [self.conv_img(image)]
        for layer in (
            self.layer1_img,
            self.layer2_img,
            self.layer3_img,
            self.layer4_img,
            self.layer5_img,
        ):
            features.append(layer(features[-1]))
        estimate: Tensor = self.pred5(features.pop(), None, sparse_depth, K)
        for scale in (self.pred4, self.pred3, self.pred2, self.pred1, self.pred0):
            estimate = scale(features.pop(), estimate, sparse_depth, K)
        return estimate[:, -1:]


class Scale(nn.Module):
    """One scale: pre-processing by propagation, multi-modal fusion, refinement.

    level: 0 at full resolution, one more each time it halves. channels: of all levels.
    """

    def __init__(self, level: int, channels: list[int]) -> None:
        super().__init__()
        self.downscale = 2**level
        here = channels[level]
        self.upcat = UpConcat(channels[level + 1] + 1, here) if level + 1 < LEVELS else None
        self.wpool = WeightedPool(here, level) if level else None
        self.prop = BilateralPropagation(here)
        self.fuse = Fusion(channels[level:])
        self.conv = nn.Conv2d(here, 1, 3, padding=1)
        self.cspn = Refinement(here, steps=2 * (LEVELS - level))

    def forward(
        self,
        features: Float[Tensor, "batch channels low_height low_width"],
        coarser: Float[Tensor, "batch coarser_outputs coarse_height coarse_width"] | None,
        sparse_depth: Float[Tensor, "batch 1 height width"],
        K: Float[Tensor, "3 3"],
    ) -> Float[Tensor, "batch outputs low_height low_width"]:
        """Fused features, and depth as the last channel. coarser: the same, from one level up.

        features: of the image.
        """
        # the published weights know K by plain division, without the shift of pixel centres
        K = K / K.new_tensor([[self.downscale], [self.downscale], [1]])
        if self.upcat is not None:
            features = self.upcat(coarser, features)
        sparse = sparse_depth if self.wpool is None else self.wpool(sparse_depth, features)
        depth = self.prop(features, _points(sparse, K))
        features = self.fuse(torch.cat((features, _points(depth, K)), dim=1))
        depth = depth + self.conv(features)
        return torch.cat((features, self.cspn(features, depth, sparse)), dim=1)


def _points(
    depth: Float[Tensor, "batch 1 height width"], K: Float[Tensor, "3 3"]
) -> Float[Tensor, "batch 3 height width"]:
    return unproject(depth[:, 0], K).movedim(-1, 1)


class Fusion(nn.Module):
    """A U-Net over the image features and the points of a depth map."""

    def __init__(self, channels: list[int]) -> None:
        super().__init__()
        first, pairs = channels[0], list(pairwise(channels))
        stem = nn.Sequential(conv_unit(first + 3, first), residual_stage(first, first, blocks=2))
        down = (residual_stage(fine, coarse, blocks=2, stride=2) for fine, coarse in pairs)
        self.encoder = nn.ModuleList([stem, *down])
        self.decoder = nn.ModuleList(UpConcat(coarse, fine) for fine, coarse in pairs)

    def forward(
        self, x: Float[Tensor, "batch inputs height width"]
    ) -> Float[Tensor, "batch channels height width"]:
        skips = []
        for stage in self.encoder:
            x = stage(x)
            skips.append(x)
        x = skips.pop()
        for up in reversed(self.decoder):
            x = up(x, skips.pop())
        return x
