"""The encoder of CompletionFormer: a pyramid of joint convolution-attention blocks.

Wang et al., "Pyramid Vision Transformer", ICCV 2021, with a convolutional branch in each block.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from steered_marigold.methods.residual import ResidualBlock, residual_stage


@dataclass(frozen=True)
class Stage:
    """One scale of the transformer.

    heads: of the attention, each `width` channels wide. blocks: how many. expansion: hidden
    channels of the perceptron over channels. reduction: side of the squares that keys and values
    are pooled over. grid: side of the learned grid of positions.
    """

    heads: int
    blocks: int
    expansion: int
    reduction: int
    grid: int


STAGES = (
    Stage(heads=1, blocks=3, expansion=8, reduction=8, grid=112),
    Stage(heads=2, blocks=4, expansion=8, reduction=4, grid=28),
    Stage(heads=5, blocks=6, expansion=4, reduction=2, grid=14),
    Stage(heads=8, blocks=3, expansion=4, reduction=1, grid=7),
)


class Pyramid(nn.Module):
    """Features at 1, 1/2, 1/4, 1/8, 1/16 and 1/32 of the image's size, rounded down from 1/4 on.

    Channels in units of `width`: 1, 2, 1, 2, 5, 8.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.embed_layer1 = residual_stage(width, width, blocks=3)
        self.embed_layer2 = residual_stage(width, 2 * width, blocks=4, stride=2)
        inputs = 2 * width
        for number, stage in enumerate(STAGES, start=1):
            channels = stage.heads * width
            # the last stage's first position belonged to a class token, and is not used
            positions = stage.grid**2 + (stage is STAGES[-1])
            embedding = nn.Parameter(torch.empty(1, positions, channels).normal_(std=0.02))
            blocks = nn.ModuleList(JointBlock(channels, stage) for _ in range(stage.blocks))
            self.register_parameter(f"pos_embed{number}", embedding)
            self.add_module(f"patch_embed{number}", PatchEmbedding(inputs, channels))
            self.add_module(f"block{number}", blocks)
            inputs = channels

    def forward(
        self, x: Float[Tensor, "batch width height width_px"]
    ) -> list[Float[Tensor, "batch _ _ _"]]:
        """One map a scale, finest first."""
        outputs = [self.embed_layer1(x)]
        outputs.append(self.embed_layer2(outputs[-1]))
        for number, stage in enumerate(STAGES, start=1):
            x = getattr(self, f"patch_embed{number}")(outputs[-1])
            positions = getattr(self, f"pos_embed{number}")[:, -(stage.grid**2) :]
            positions = positions.transpose(1, 2).unflatten(2, (stage.grid, stage.grid))
            x = x + F.interpolate(positions, size=x.shape[2:], mode="bilinear")
            for block in getattr(self, f"block{number}"):
                x = block(x)
            outputs.append(x)
        return outputs


class PatchEmbedding(nn.Module):
    """Halves height and width, rounding down, and normalises each pixel over its channels."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.proj = nn.Conv2d(inputs, outputs, 2, stride=2)
        self.norm = nn.LayerNorm(outputs)

    def forward(
        self, x: Float[Tensor, "batch inputs height width"]
    ) -> Float[Tensor, "batch outputs half_height half_width"]:
        x = self.proj(x)
        return _as_map(self.norm(_as_tokens(x)), x)


class JointBlock(nn.Module):
    """The paper's JCAT: a transformer block and a convolutional block side by side, merged."""

    def __init__(self, channels: int, stage: Stage) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(channels, eps=1e-6)
        self.attn = Attention(channels, stage)
        self.norm2 = nn.LayerNorm(channels, eps=1e-6)
        self.mlp = Perceptron(channels, stage.expansion * channels)
        self.resblock = ResidualBlock(channels, channels, attention_channels=channels // 16)
        self.concat_conv = nn.Conv2d(2 * channels, channels, 3, padding=1, bias=False)

    def forward(
        self, x: Float[Tensor, "batch channels height width"]
    ) -> Float[Tensor, "batch channels height width"]:
        tokens = _as_tokens(x)
        normed = self.norm1(tokens)
        tokens = tokens + self.attn(normed, _as_map(normed, x))
        tokens = tokens + self.mlp(self.norm2(tokens))
        merged: Tensor = self.concat_conv(torch.cat((_as_map(tokens, x), self.resblock(x)), dim=1))
        return merged


class Attention(nn.Module):
    """PVT's attention of all pixels to keys and values from a reduced map."""

    def __init__(self, channels: int, stage: Stage) -> None:
        super().__init__()
        self.heads = stage.heads
        self.q = nn.Linear(channels, channels)
        self.kv = nn.Linear(channels, 2 * channels)
        self.proj = nn.Linear(channels, channels)
        self.reduced = stage.reduction > 1
        if self.reduced:
            self.sr = nn.Conv2d(channels, channels, stage.reduction, stride=stage.reduction)
            self.norm = nn.LayerNorm(channels)

    def forward(
        self,
        tokens: Float[Tensor, "batch pixels channels"],
        x: Float[Tensor, "batch channels height width"],
    ) -> Float[Tensor, "batch pixels channels"]:
        """tokens and x: the same values in two layouts."""
        source = self.norm(_as_tokens(self.sr(x))) if self.reduced else tokens
        query, key, value = (
            torch.unflatten(part, 2, (self.heads, -1)).transpose(1, 2)
            for part in (self.q(tokens), *self.kv(source).chunk(2, dim=2))
        )
        attended = F.scaled_dot_product_attention(query, key, value)
        projected: Tensor = self.proj(attended.transpose(1, 2).flatten(2))
        return projected


class Perceptron(nn.Module):
    """Two linear layers over the channels of each pixel."""

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.fc1 = nn.Linear(channels, hidden)
        self.fc2 = nn.Linear(hidden, channels)

    def forward(
        self, tokens: Float[Tensor, "batch pixels channels"]
    ) -> Float[Tensor, "batch pixels channels"]:
        output: Tensor = self.fc2(F.gelu(self.fc1(tokens)))
        return output


def _as_tokens(
    x: Float[Tensor, "batch channels height width"],
) -> Float[Tensor, "batch pixels channels"]:
    return x.flatten(2).transpose(1, 2)


def _as_map(
    tokens: Float[Tensor, "batch pixels channels"],
    like: Float[Tensor, "batch _ height width"],
) -> Float[Tensor, "batch channels height width"]:
    return torch.unflatten(tokens.transpose(1, 2), 2, like.shape[2:])
