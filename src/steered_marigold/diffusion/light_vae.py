"""The embedded checkpoint's VAE without diffusers, whose import takes seconds."""

from collections.abc import Iterable, Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any, Literal, cast

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from steered_marigold.diffusion.light_blocks import Resampler, ResidualBlock, Stage

EPS = 1e-6


class LightEncoder(nn.Module):
    """`Encoder` of `AutoencoderKL`, without attention."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        widths, groups = config["block_out_channels"], config["norm_num_groups"]
        residual = partial(ResidualBlock, groups=groups, eps=EPS)
        self.conv_in = nn.Conv2d(3, widths[0], 3, padding=1)
        stages: list[Stage] = []
        channels = widths[0]
        for width in widths:
            last = len(stages) == len(widths) - 1
            resnets = [
                residual(width if i else channels, width) for i in range(config["layers_per_block"])
            ]
            down = [] if last else [Resampler(width, stride=2, padding=0)]
            stages.append(Stage(resnets, down=down))
            channels = width
        self.down_blocks = nn.ModuleList(stages)
        self.mid_block = Stage([residual(channels, channels) for _ in range(2)])
        self.conv_norm_out = nn.GroupNorm(groups, channels, eps=EPS)
        self.conv_out = nn.Conv2d(channels, 2 * config["latent_channels"], 3, padding=1)

    def forward(self, image: Float[Tensor, "batch 3 height width"]) -> Tensor:
        """Mean and log variance of the latents, before the last convolution."""
        x = self.conv_in(image)
        for stage in cast(Iterable[Stage], self.down_blocks):
            x = stage(x)
            for downsampler in stage.downsamplers:
                x = downsampler(F.pad(x, (0, 1, 0, 1)))
        moments: Tensor = self.conv_out(F.silu(self.conv_norm_out(self.mid_block(x))))
        return moments


class LightDecoder(nn.Module):
    """`Decoder` of `AutoencoderKL`, without attention."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        widths, groups = config["block_out_channels"], config["norm_num_groups"]
        residual = partial(ResidualBlock, groups=groups, eps=EPS)
        channels = widths[-1]
        self.conv_in = nn.Conv2d(config["latent_channels"], channels, 3, padding=1)
        self.mid_block = Stage([residual(channels, channels) for _ in range(2)])
        stages: list[Stage] = []
        for width in reversed(widths):
            last = len(stages) == len(widths) - 1
            resnets = [
                residual(width if i else channels, width)
                for i in range(config["layers_per_block"] + 1)
            ]
            stages.append(Stage(resnets, up=[] if last else [Resampler(width)]))
            channels = width
        self.up_blocks = nn.ModuleList(stages)
        self.conv_norm_out = nn.GroupNorm(groups, channels, eps=EPS)
        self.conv_out = nn.Conv2d(channels, 3, 3, padding=1)

    def forward(self, latents: Float[Tensor, "batch channels h w"]) -> Tensor:
        """The image of latents."""
        x = self.mid_block(self.conv_in(latents))
        for stage in cast(Iterable[Stage], self.up_blocks):
            x = stage(x)
            for upsampler in stage.upsamplers:
                x = upsampler(F.interpolate(x, scale_factor=2.0))
        image: Tensor = self.conv_out(F.silu(self.conv_norm_out(x)))
        return image


class LightVae(nn.Module):
    """`AutoencoderKL` without attention, called as `DepthCodec` calls that.

    config: of that class, of which the sizes are read.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        self.config = SimpleNamespace(**config)
        channels = config["latent_channels"]
        self.encoder = LightEncoder(config)
        self.decoder = LightDecoder(config)
        self.quant_conv = nn.Conv2d(2 * channels, 2 * channels, 1)
        self.post_quant_conv = nn.Conv2d(channels, channels, 1)

    @property
    def dtype(self) -> torch.dtype:
        """Of the weights."""
        return self.quant_conv.weight.dtype

    def encode(
        self, image: Float[Tensor, "batch 3 height width"]
    ) -> dict[Literal["latents"], Float[Tensor, "batch channels h w"]]:
        """The posterior's mode, unscaled."""
        return {"latents": self.quant_conv(self.encoder(image)).chunk(2, dim=1)[0]}

    def decode(
        self, latents: Float[Tensor, "batch channels h w"], *, return_dict: Literal[False]
    ) -> tuple[Float[Tensor, "batch 3 height width"]]:
        """The image of unscaled latents."""
        return (self.decoder(self.post_quant_conv(latents)),)
