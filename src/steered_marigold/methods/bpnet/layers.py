"""Convolutions of BP-Net, nested as the names of its published weights are."""

from collections import OrderedDict

import torch
from jaxtyping import Float
from torch import Tensor, nn


def conv_unit(
    inputs: int, outputs: int, *, size: int = 3, norm: bool = True, act: nn.Module | None = None
) -> nn.Sequential:
    """Convolution, batch norm in place of a bias, activation (default ReLU)."""
    layers: OrderedDict[str, nn.Module] = OrderedDict()
    layers["conv"] = nn.Conv2d(inputs, outputs, size, padding=size // 2, bias=not norm)
    if norm:
        layers["bn"] = nn.BatchNorm2d(outputs)
    layers["act"] = nn.ReLU() if act is None else act
    return named(conv=nn.Sequential(layers))


def named(**layers: nn.Module) -> nn.Sequential:
    """A sequence of layers with names in place of numbers."""
    return nn.Sequential(OrderedDict(layers))


class UpConcat(nn.Module):
    """Doubles height and width of coarse features and merges them with fine ones."""

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.upf = named(
            conv=nn.ConvTranspose2d(coarse, fine, 4, stride=2, padding=1, bias=False),
            bn=nn.BatchNorm2d(fine),
            act=nn.ReLU(),
        )
        self.conv = conv_unit(2 * fine, fine)

    def forward(
        self,
        coarse: Float[Tensor, "batch coarse coarse_height coarse_width"],
        fine: Float[Tensor, "batch fine height width"],
    ) -> Float[Tensor, "batch fine height width"]:
        merged: Tensor = self.conv(torch.cat((self.upf(coarse), fine), dim=1))
        return merged
