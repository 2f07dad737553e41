"""The residual block of both learned baselines, under the names of their published weights."""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """He et al., "Deep Residual Learning for Image Recognition", CVPR 2016: two 3x3 convolutions.

    attention_channels: hidden channels of the channel attention. If given, the residual is weighted
    by channel and then by place before it is added (Woo et al., "CBAM", ECCV 2018).
    """

    def __init__(
        self, inputs: int, outputs: int, *, stride: int = 1, attention_channels: int | None = None
    ) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU(inplace=True)
        self.attention = attention_channels is not None
        if attention_channels is not None:
            self.ca = ChannelAttention(outputs, attention_channels)
            self.sa = SpatialAttention()
        self.downsample = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(
        self, x: Float[Tensor, "batch inputs height width"]
    ) -> Float[Tensor, "batch outputs new_height new_width"]:
        residual = self.bn2(self.conv2(self.relu(self.bn1(self.conv1(x)))))
        if self.attention:
            residual = self.ca(residual) * residual
            residual = self.sa(residual) * residual
        identity = x if self.downsample is None else self.downsample(x)
        return torch.relu(residual + identity)


class ChannelAttention(nn.Module):
    """CBAM, Eq. 2: one weight in (0, 1) a channel, from its mean and its maximum."""

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.fc = nn.Sequential(
            nn.Conv2d(channels, hidden, 1, bias=False),
            nn.ReLU(),
            nn.Conv2d(hidden, channels, 1, bias=False),
        )

    def forward(
        self, x: Float[Tensor, "batch channels height width"]
    ) -> Float[Tensor, "batch channels 1 1"]:
        mean, maximum = x.mean((2, 3), keepdim=True), x.amax((2, 3), keepdim=True)
        return torch.sigmoid(self.fc(mean) + self.fc(maximum))


class SpatialAttention(nn.Module):
    """CBAM, Eq. 3: one weight in (0, 1) a pixel, from mean and maximum over its channels."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(2, 1, 7, padding=3, bias=False)

    def forward(
        self, x: Float[Tensor, "batch channels height width"]
    ) -> Float[Tensor, "batch 1 height width"]:
        pooled = torch.cat((x.mean(1, keepdim=True), x.amax(1, keepdim=True)), dim=1)
        return torch.sigmoid(self.conv1(pooled))


def residual_stage(inputs: int, outputs: int, *, blocks: int, stride: int = 1) -> nn.Sequential:
    """Residual blocks in a row; the first one changes channels and size."""
    return nn.Sequential(
        ResidualBlock(inputs, outputs, stride=stride),
        *(ResidualBlock(outputs, outputs) for _ in range(blocks - 1)),
    )
