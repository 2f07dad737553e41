"""A small convolutional image encoder: stands in for the VAE on the image side of the U-Net."""

from typing import Any

import torch
from diffusers.configuration_utils import ConfigMixin, register_to_config
from diffusers.models.modeling_utils import ModelMixin
from torch import Tensor, nn

from steered_marigold.diffusion.image_network import ImageNetwork, InvertedBottleneck


class ImageEncoder(ImageNetwork, ModelMixin, ConfigMixin):  # type: ignore[misc]
    """`ImageNetwork` as a component of a diffusers pipeline; the arguments are its own."""

    config: Any

    @register_to_config  # type: ignore[untyped-decorator]
    def __init__(
        self, backbone: str = "lite2", latent_channels: int = 32, pyramid_channels: int = 128
    ) -> None:
        super().__init__(backbone, latent_channels, pyramid_channels)


def load_pretrained_backbone(encoder: ImageEncoder, state: dict[str, Tensor]) -> None:
    """Fill stem and stages from a state dict in EfficientNet-PyTorch's names, BatchNorm folded."""
    folded = _FoldedState(state)
    folded.copy("_conv_stem", "_bn0", encoder.stem)
    blocks = [m for m in encoder.stages.modules() if isinstance(m, InvertedBottleneck)]
    for i, block in enumerate(blocks):
        prefix = f"_blocks.{i}."
        if not isinstance(block.expand, nn.Identity):
            folded.copy(f"{prefix}_expand_conv", f"{prefix}_bn0", block.expand)
        folded.copy(f"{prefix}_depthwise_conv", f"{prefix}_bn1", block.depthwise)
        folded.copy(f"{prefix}_project_conv", f"{prefix}_bn2", block.project)


class _FoldedState:
    """A state dict whose BatchNorms are folded as they are read: w' = w g / sigma."""

    def __init__(self, state: dict[str, Tensor], epsilon: float = 1e-3) -> None:
        self.state, self.epsilon = state, epsilon

    @torch.no_grad()
    def copy(self, conv: str, norm: str, target: nn.Conv2d) -> None:
        mean, var = self.state[f"{norm}.running_mean"], self.state[f"{norm}.running_var"]
        gain = self.state[f"{norm}.weight"] / (var + self.epsilon).sqrt()
        target.weight.copy_(self.state[f"{conv}.weight"] * gain[:, None, None, None])
        assert target.bias is not None
        target.bias.copy_(self.state[f"{norm}.bias"] - mean * gain)
