"""Blocks of the light U-Net and VAE: those of diffusers, whose import takes seconds.

Names of layers, and so of weights, and the order of operations are those of diffusers, as far as
the embedded checkpoint needs them.
"""

from collections.abc import Sequence
from typing import cast

import torch.nn.functional as F
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """`ResnetBlock2D`. time_channels: 0 in a VAE."""

    def __init__(
        self, channels: int, out: int, *, groups: int, eps: float, time_channels: int = 0
    ) -> None:
        super().__init__()
        self.norm1 = nn.GroupNorm(groups, channels, eps=eps)
        self.conv1 = nn.Conv2d(channels, out, 3, padding=1)
        if time_channels:
            self.time_emb_proj = nn.Linear(time_channels, out)
        self.norm2 = nn.GroupNorm(groups, out, eps=eps)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1)
        if channels != out:
            self.conv_shortcut = nn.Conv2d(channels, out, 1)

    def forward(self, x: Tensor, time: Tensor | None = None) -> Tensor:
        y: Tensor = self.conv1(F.silu(self.norm1(x)))
        if time is not None:
            y = y + self.time_emb_proj(F.silu(time))[:, :, None, None]
        y = self.conv2(F.silu(self.norm2(y)))
        return y + (self.conv_shortcut(x) if hasattr(self, "conv_shortcut") else x)


class SelfAttention(nn.Module):
    """`Attention` of x to itself."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.to_q = nn.Linear(channels, channels, bias=False)
        self.to_k = nn.Linear(channels, channels, bias=False)
        self.to_v = nn.Linear(channels, channels, bias=False)
        self.to_out = nn.ModuleList([nn.Linear(channels, channels)])

    def forward(self, x: Tensor) -> Tensor:
        q, k, v = (
            to(x).unflatten(2, (self.heads, -1)).transpose(1, 2)
            for to in (self.to_q, self.to_k, self.to_v)
        )
        mixed = F.scaled_dot_product_attention(q, k, v)
        result: Tensor = self.to_out[0](mixed.transpose(1, 2).flatten(2))
        return result


class NullAttention(nn.Module):
    """`Attention` to a prompt whose embedding is 0: only the output's bias is left of it."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.to_out = nn.ModuleList([nn.Linear(channels, channels)])

    def forward(self) -> Tensor:
        return cast(nn.Linear, self.to_out[0]).bias


class GatedLinear(nn.Module):
    """`GEGLU` (Shazeer 2020)."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__()
        self.proj = nn.Linear(channels, 2 * out)

    def forward(self, x: Tensor) -> Tensor:
        values, gate = self.proj(x).chunk(2, dim=-1)
        gated: Tensor = values * F.gelu(gate)
        return gated


class FeedForward(nn.Module):
    """Widens by four, gated."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        wide = 4 * channels
        self.net = nn.Sequential(
            GatedLinear(channels, wide), nn.Identity(), nn.Linear(wide, channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.net(x)
        return result


class TransformerBlock(nn.Module):
    """`BasicTransformerBlock`, whose prompt is embedded as 0."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.norm1, self.norm3 = nn.LayerNorm(channels), nn.LayerNorm(channels)
        self.attn1 = SelfAttention(channels, heads)
        self.attn2 = NullAttention(channels)
        self.ff = FeedForward(channels)

    def forward(self, x: Tensor) -> Tensor:
        x = self.attn1(self.norm1(x)) + x
        x = self.attn2() + x
        result: Tensor = self.ff(self.norm3(x)) + x
        return result


class Transformer(nn.Module):
    """`Transformer2DModel` of one block."""

    def __init__(self, channels: int, *, heads: int, groups: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(groups, channels, eps=1e-6)
        self.proj_in = nn.Conv2d(channels, channels, 1)
        self.transformer_blocks = nn.Sequential(TransformerBlock(channels, heads))
        self.proj_out = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        height, width = x.shape[2:]
        y = self.proj_in(self.norm(x)).flatten(2).transpose(1, 2)
        y = self.transformer_blocks(y).transpose(1, 2).unflatten(2, (height, width))
        result: Tensor = self.proj_out(y.contiguous()) + x
        return result


class Resampler(nn.Module):
    """The convolution of `Downsample2D` and `Upsample2D`."""

    def __init__(self, channels: int, *, stride: int = 1, padding: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(channels, channels, 3, stride=stride, padding=padding)

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.conv(x)
        return result


class Stage(nn.Module):
    """The blocks at one resolution: residual ones, each followed by a transformer if there are any.

    down, up: what follows them, each a list of at most one, which the network applies.
    """

    def __init__(
        self,
        resnets: Sequence[nn.Module],
        attentions: Sequence[nn.Module] = (),
        *,
        down: Sequence[Resampler] = (),
        up: Sequence[Resampler] = (),
    ) -> None:
        super().__init__()
        self.resnets, self.attentions = nn.ModuleList(resnets), nn.ModuleList(attentions)
        self.downsamplers, self.upsamplers = nn.ModuleList(down), nn.ModuleList(up)

    def block(self, i: int, x: Tensor, time: Tensor | None = None) -> Tensor:
        """One residual block and what follows it."""
        x = self.resnets[i](x, time)
        return self.attentions[i](x) if len(self.attentions) else x

    def forward(self, x: Tensor) -> Tensor:
        """All blocks, without a time."""
        for i in range(len(self.resnets)):
            x = self.block(i, x)
        return x
