"""The layers of the image encoder, without diffusers, whose import takes seconds.

The backbone is EfficientNet-Lite (Tan and Le, ICML 2019; the Lite variants have neither
squeeze-excite nor swish) with every BatchNorm folded into its convolution. A feature pyramid
(Lin et al., CVPR 2017) brings its levels to one eighth of the image's resolution.
"""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

# (channels, repeats, kernel, stride, expansion) of each stage; the fixed stem has 32 channels
Stage = tuple[int, int, int, int, int]
LITE_STAGES: dict[str, tuple[Stage, ...]] = {
    "lite0": (
        (16, 1, 3, 1, 1),
        (24, 2, 3, 2, 6),
        (40, 2, 5, 2, 6),
        (80, 3, 3, 2, 6),
        (112, 3, 5, 1, 6),
        (192, 4, 5, 2, 6),
        (320, 1, 3, 1, 6),
    ),
    "lite2": (
        (16, 1, 3, 1, 1),
        (24, 3, 3, 2, 6),
        (48, 3, 5, 2, 6),
        (88, 4, 3, 2, 6),
        (120, 4, 5, 1, 6),
        (208, 5, 5, 2, 6),
        (352, 1, 3, 1, 6),
    ),
}
STEM_CHANNELS = 32
# the last stage at 1/4, 1/8, 1/16 and 1/32 of the image's resolution
PYRAMID_STAGES = (1, 2, 4, 6)


class SameConv2d(nn.Conv2d):
    """Convolution with TensorFlow's "SAME" padding, which the pretrained weights expect.

    Sizes are even wherever the stride is 2, so the padding depends on kernel and stride alone.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, *, stride: int = 1, groups: int = 1
    ) -> None:
        super().__init__(
            in_channels,
            out_channels,
            kernel,
            stride=stride,
            padding=kernel // 2 if stride == 1 else 0,
            groups=groups,
        )

    def forward(self, x: Tensor) -> Tensor:
        if self.stride[0] == 2:
            before = (self.kernel_size[0] - 2) // 2
            after = self.kernel_size[0] - 2 - before
            x = F.pad(x, (before, after, before, after))
        return super().forward(x)


class InvertedBottleneck(nn.Module):
    """MBConv without squeeze-excite: expand, depthwise, project (Sandler et al., CVPR 2018)."""

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, *, stride: int, expansion: int
    ) -> None:
        super().__init__()
        width = in_channels * expansion
        self.expand = SameConv2d(in_channels, width, 1) if expansion > 1 else nn.Identity()
        self.depthwise = SameConv2d(width, width, kernel, stride=stride, groups=width)
        self.project = SameConv2d(width, out_channels, 1)
        self.residual = stride == 1 and in_channels == out_channels

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = x if isinstance(self.expand, nn.Identity) else F.relu6(self.expand(x))
        y = self.project(F.relu6(self.depthwise(y)))
        return x + y if self.residual else y


class ResidualBlock(nn.Module):
    """Two normalised 3x3 convolutions around a skip connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.GroupNorm(8, channels),
            nn.SiLU(),
            nn.Conv2d(channels, channels, 3, padding=1),
            nn.GroupNorm(8, channels),
            nn.SiLU(),
            nn.Conv2d(channels, channels, 3, padding=1),
        )

    def forward(self, x: Tensor) -> Tensor:
        change: Tensor = self.layers(x)
        return x + change


class ImageNetwork(nn.Module):
    """Image to latents at one eighth of its resolution.

    backbone: a key of `LITE_STAGES`. latent_channels: channels of the output.
    pyramid_channels: width of the feature pyramid.
    """

    def __init__(self, backbone: str, latent_channels: int, pyramid_channels: int) -> None:
        super().__init__()
        stages = LITE_STAGES[backbone]
        self.stem = SameConv2d(3, STEM_CHANNELS, 3, stride=2)
        self.stages = nn.ModuleList()
        channels = STEM_CHANNELS
        for out_channels, repeats, kernel, stride, expansion in stages:
            blocks = []
            for i in range(repeats):
                blocks.append(
                    InvertedBottleneck(
                        channels,
                        out_channels,
                        kernel,
                        stride=stride if i == 0 else 1,
                        expansion=expansion,
                    )
                )
                channels = out_channels
            self.stages.append(nn.Sequential(*blocks))
        fine, *levels = (stages[i][0] for i in PYRAMID_STAGES)
        self.context = nn.Linear(levels[-1], pyramid_channels)
        self.laterals = nn.ModuleList(nn.Conv2d(c, pyramid_channels, 1) for c in levels)
        self.fine = nn.Conv2d(4 * fine, pyramid_channels, 1)
        self.blocks = nn.ModuleList(ResidualBlock(pyramid_channels) for _ in levels)
        self.norm_out = nn.GroupNorm(8, pyramid_channels)
        self.conv_out = nn.Conv2d(pyramid_channels, latent_channels, 1)

    def forward(
        self, image: Float[Tensor, "batch 3 height width"]
    ) -> Float[Tensor, "batch channels height/8 width/8"]:
        """Latents of an RGB image in [-1, 1] whose sides are multiples of 8."""
        height, width = image.shape[-2:]
        # the pyramid needs multiples of 32; replicated borders look like more of the same wall
        x = F.pad(image, (0, -width % 32, 0, -height % 32), mode="replicate")
        x = F.relu6(self.stem(x))
        levels = []
        for i, stage in enumerate(self.stages):
            x = stage(x)
            if i in PYRAMID_STAGES:
                levels.append(x)
        fine, *coarse = levels
        y: Tensor = self.context(coarse[-1].mean(dim=(2, 3)))[:, :, None, None]
        for lateral, block, level in reversed(
            list(zip(self.laterals, self.blocks, coarse, strict=True))
        ):
            if level is not coarse[-1]:
                y = F.interpolate(y, scale_factor=2.0, mode="bilinear")
            y = lateral(level) + y
            if level is coarse[0]:
                y = y + self.fine(F.pixel_unshuffle(fine, 2))
            y = block(y)
        y = self.conv_out(F.silu(self.norm_out(y)))
        return y[:, :, : height // 8, : width // 8]
