"""The network of CompletionFormer: encoder, decoder with three heads, propagation."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from steered_marigold.methods.completionformer.propagation import NEIGHBOURS, NonLocalPropagation
from steered_marigold.methods.completionformer.pyramid import Pyramid
from steered_marigold.methods.residual import ResidualBlock

MIN_SIDE = 32


class CompletionFormer(nn.Module):
    """Zhang et al., "CompletionFormer: Depth Completion with Convolutions and Vision Transformers"
    (arXiv 2304.13030).

    Stochastic depth, a regulariser of training, is left out.

    width: channels at full resolution, a multiple of 16; the published weights have 64.
    """

    def __init__(self, *, width: int = 64) -> None:
        super().__init__()
        self.backbone = Backbone(width)
        self.prop_layer = NonLocalPropagation()

    def forward(
        self,
        image: Float[Tensor, "batch 3 height width"],
        sparse_depth: Float[Tensor, "batch 1 height width"],
    ) -> Float[Tensor, "batch 1 height width"]:
        """Dense depth [m], not negative. Height and width must be at least 32.

        image: normalised. sparse_depth: [m], 0 where nothing was measured.
        """
        depth, guidance, confidence = self.backbone(image, sparse_depth)
        refined: Tensor = self.prop_layer(depth + sparse_depth, guidance, confidence)
        return refined.clamp(min=0)


class Backbone(nn.Module):
    """From image and sparse depth to a first depth, guidance for the propagation and confidence."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv1_rgb = _conv(3, 3 * width // 4, act=nn.ReLU())
        self.conv1_dep = _conv(1, width // 4, act=nn.ReLU())
        self.conv1 = _conv(width, width, act=nn.ReLU())
        self.former = Pyramid(width)
        self.dec6 = _up(8 * width, 4 * width, width // 4)
        self.dec5 = _up((4 + 5) * width, 2 * width, width // 4)
        self.dec4 = _up((2 + 2) * width, width, width // 4)
        self.dec3 = _up((1 + 1) * width, width, width // 4)
        self.dec2 = _up((1 + 2) * width, width, width // 4)
        self.dep_dec1 = _conv_norm(2 * width, width)
        self.dep_dec0 = _conv(2 * width, 1, act=nn.ReLU())
        self.gd_dec1 = _conv_norm(2 * width, width)
        self.gd_dec0 = _conv(2 * width, NEIGHBOURS)
        self.cf_dec1 = _conv_norm(2 * width, width // 2)
        self.cf_dec0 = _conv(3 * width // 2, 1, act=nn.Sigmoid())

    def forward(
        self,
        image: Float[Tensor, "batch 3 height width"],
        sparse_depth: Float[Tensor, "batch 1 height width"],
    ) -> tuple[
        Float[Tensor, "batch 1 height width"],
        Float[Tensor, "batch 8 height width"],
        Float[Tensor, "batch 1 height width"],
    ]:
        both = torch.cat((self.conv1_rgb(image), self.conv1_dep(sparse_depth)), dim=1)
        stem = self.conv1(both)
        full, *encoded, x = self.former(stem)
        x = self.dec6(x)
        for decoder in (self.dec5, self.dec4, self.dec3, self.dec2):
            x = decoder(_concat(x, encoded.pop()))
        x = _concat(x, full)
        return (
            self.dep_dec0(torch.cat((self.dep_dec1(x), stem), dim=1)),
            self.gd_dec0(torch.cat((self.gd_dec1(x), stem), dim=1)),
            self.cf_dec0(torch.cat((self.cf_dec1(x), stem), dim=1)),
        )


def _concat(
    decoded: Float[Tensor, "batch channels _ _"],
    encoded: Float[Tensor, "batch encoded_channels height width"],
) -> Float[Tensor, "batch all_channels height width"]:
    """Both at the encoder's size: it rounds down where it halves, the decoder only doubles."""
    size = encoded.shape[2:]
    decoded = F.interpolate(decoded, size, mode="bilinear", align_corners=True)
    return torch.cat((decoded, encoded), dim=1)


def _conv(inputs: int, outputs: int, *, act: nn.Module | None = None) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, padding=1)
    return nn.Sequential(conv) if act is None else nn.Sequential(conv, act)


def _conv_norm(inputs: int, outputs: int) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, padding=1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU())


def _up(inputs: int, outputs: int, attention_channels: int) -> nn.Sequential:
    """Doubles height and width."""
    conv = nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1, bias=False)
    return nn.Sequential(
        nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU()),
        ResidualBlock(outputs, outputs, attention_channels=attention_channels),
    )
