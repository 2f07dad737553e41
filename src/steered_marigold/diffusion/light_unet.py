"""The embedded checkpoint's U-Net without diffusers, whose import takes seconds."""

import math
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any, cast

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from steered_marigold.diffusion.light_blocks import Resampler, ResidualBlock, Stage, Transformer


class LightUNet(nn.Module):
    """`UNet2DConditionModel` for a prompt whose embedding is 0.

    config: of that class, of which the sizes are read, and which blocks have attention; everything
    else is as in the embedded checkpoint.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        widths, groups = config["block_out_channels"], config["norm_num_groups"]
        eps, layers = config["norm_eps"], config["layers_per_block"]
        time = 4 * widths[0]
        residual = partial(ResidualBlock, groups=groups, eps=eps, time_channels=time)
        transformer = partial(Transformer, heads=config["attention_head_dim"], groups=groups)
        self.time_embedding = nn.ModuleDict(
            {"linear_1": nn.Linear(widths[0], time), "linear_2": nn.Linear(time, time)}
        )
        self.conv_in = nn.Conv2d(config["in_channels"], widths[0], 3, padding=1)
        stages: list[Stage] = []
        skips, channels = [widths[0]], widths[0]
        for kind, width in zip(config["down_block_types"], widths, strict=True):
            last = len(stages) == len(widths) - 1
            resnets = [residual(width if i else channels, width) for i in range(layers)]
            attentions = [transformer(width) for _ in resnets if "Attn" in kind]
            stages.append(
                Stage(resnets, attentions, down=[] if last else [Resampler(width, stride=2)])
            )
            skips += [width] * (layers if last else layers + 1)
            channels = width
        self.down_blocks = nn.ModuleList(stages)
        middle = [residual(channels, channels) for _ in range(2)]
        self.mid_block = Stage(middle, [transformer(channels)])
        stages = []
        for kind, width in zip(config["up_block_types"], reversed(widths), strict=True):
            last = len(stages) == len(widths) - 1
            resnets = [
                residual(skips.pop() + (width if i else channels), width) for i in range(layers + 1)
            ]
            attentions = [transformer(width) for _ in resnets if "Attn" in kind]
            stages.append(Stage(resnets, attentions, up=[] if last else [Resampler(width)]))
            channels = width
        self.up_blocks = nn.ModuleList(stages)
        self.conv_norm_out = nn.GroupNorm(groups, channels, eps=eps)
        self.conv_out = nn.Conv2d(channels, config["out_channels"], 3, padding=1)

    def forward(
        self, x: Float[Tensor, "batch channels h w"], t: Tensor
    ) -> Float[Tensor, "batch out h w"]:
        """The U-Net's output for latents at timestep t."""
        time = self._time(t, x)
        x = self.conv_in(x)
        skips = [x]
        for stage in cast(Iterable[Stage], self.down_blocks):
            for i in range(len(stage.resnets)):
                x = stage.block(i, x, time)
                skips.append(x)
            for downsampler in stage.downsamplers:
                x = downsampler(x)
                skips.append(x)
        x = self.mid_block.block(0, x, time)
        x = self.mid_block.resnets[1](x, time)
        for stage in cast(Iterable[Stage], self.up_blocks):
            for i in range(len(stage.resnets)):
                x = stage.block(i, torch.cat([x, skips.pop()], dim=1), time)
            for upsampler in stage.upsamplers:
                x = upsampler(F.interpolate(x, size=skips[-1].shape[2:]))
        result: Tensor = self.conv_out(F.silu(self.conv_norm_out(x)))
        return result

    def _time(self, t: Tensor, x: Tensor) -> Tensor:
        """The timestep's embedding: cosines and sines of falling frequency, two layers."""
        half = self.conv_in.out_channels // 2
        frequency = torch.arange(half, dtype=torch.float32, device=x.device)
        frequency = torch.exp(-math.log(10000) * frequency / half)
        angle = t.to(x.device).expand(len(x))[:, None].float() * frequency
        waves = torch.cat([angle.cos(), angle.sin()], dim=1).to(x.dtype)
        first, second = self.time_embedding["linear_1"], self.time_embedding["linear_2"]
        result: Tensor = second(F.silu(first(waves)))
        return result
