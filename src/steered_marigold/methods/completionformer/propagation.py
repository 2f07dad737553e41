"""Non-local spatial propagation: Park et al., "Non-Local Spatial Propagation Network for Depth
Completion", ECCV 2020 (arXiv 2007.10042)."""

from dataclasses import dataclass
from math import isqrt

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

STEPS = 6
NEIGHBOURS = 8


@dataclass(frozen=True)
class Reads:
    """Which four pixels each bilinear sample reads, and the share of each.

    index: row-major in the image, [batch, 4 * samples, pixels]. share: [batch, 4, samples, height,
    width]; 0 outside the image.
    """

    index: Int64[Tensor, "batch reads pixels"]
    share: Float[Tensor, "batch 4 samples height width"]


def bilinear_reads(offsets: Float[Tensor, "batch samples 2 height width"]) -> Reads:
    """Samples of an image at each pixel's place + offsets (y, x) [px].

    Whole pixels are added as integers and the rest stays near 0. Coordinates that run over the
    whole image, as those of grid_sample, have no float32 digits left for it.
    """
    height, width = offsets.shape[-2:]
    rows, columns = (torch.arange(size, device=offsets.device) for size in (height, width))
    pixels = torch.stack(torch.meshgrid(rows, columns, indexing="ij"))
    whole = offsets.detach().floor()
    rest_y, rest_x = (offsets - whole).unbind(2)
    top, left = (pixels + whole.long()).unbind(2)
    indices, shares = [], []
    for y, share_y in ((top, 1 - rest_y), (top + 1, rest_y)):
        for x, share_x in ((left, 1 - rest_x), (left + 1, rest_x)):
            inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            indices.append(y.clamp(0, height - 1) * width + x.clamp(0, width - 1))
            shares.append(torch.where(inside, share_y * share_x, 0))
    return Reads(torch.cat(indices, dim=1).flatten(2), torch.stack(shares, dim=1))


def sample(
    image: Float[Tensor, "batch 1 height width"], reads: Reads
) -> Float[Tensor, "batch samples height width"]:
    """The bilinear samples; the image is zero outside."""
    pixels = image.flatten(2).expand(-1, reads.index.shape[1], -1)
    values = pixels.gather(2, reads.index).view_as(reads.share)
    return (values * reads.share).sum(dim=1)


def kernel_reads(
    offsets: Float[Tensor, "batch taps 2 height width"],
) -> Reads:
    """The samples of a deformable convolution (Zhu et al., CVPR 2019, Eq. 1), stride 1.

    Tap k, row-major in a kernel of odd side, reads the pixel's place + the tap's place in the
    kernel + offset_k (y, x) [px].
    """
    reach = isqrt(offsets.shape[1]) // 2
    steps = torch.arange(-reach, reach + 1, device=offsets.device)
    return bilinear_reads(offsets + torch.cartesian_prod(steps, steps).view(-1, 2, 1, 1))


class NonLocalPropagation(nn.Module):
    """Six propagations, each pixel from eight learned places and itself.

    Measurements are not put back in between: the weights were trained without that option.
    """

    def __init__(self) -> None:
        super().__init__()
        self.conv_offset_aff = nn.Conv2d(NEIGHBOURS, 3 * NEIGHBOURS, 3, padding=1)
        for parameter in self.conv_offset_aff.parameters():
            nn.init.zeros_(parameter)
        # gamma of the paper's Tanh-Gamma-Abs-Sum* normalisation
        self.aff_scale_const = nn.Parameter(torch.full((1,), NEIGHBOURS / 2))
        # kernels that only gather, not trained
        self.w = nn.Parameter(torch.ones(1, 1, 3, 3), requires_grad=False)
        self.b = nn.Parameter(torch.zeros(1), requires_grad=False)
        self.w_conf = nn.Parameter(torch.ones(1, 1, 1, 1), requires_grad=False)

    def forward(
        self,
        depth: Float[Tensor, "batch 1 height width"],
        guidance: Float[Tensor, "batch 8 height width"],
        confidence: Float[Tensor, "batch 1 height width"],
    ) -> Float[Tensor, "batch 1 height width"]:
        """confidence: of the depth, in [0, 1]."""
        shifts_y_x, affinity = self.conv_offset_aff(guidance).split((16, 8), dim=1)
        shifts = torch.unflatten(shifts_y_x, 1, (NEIGHBOURS, 2))
        affinity = self._normalize(affinity, shifts, confidence)
        shifts = _insert_center(shifts, torch.zeros_like(shifts[:, :1]))
        affinity = _insert_center(affinity, 1 - affinity.sum(dim=1, keepdim=True))
        reads, weights = kernel_reads(shifts), affinity * self.w.view(-1, 1, 1)
        for _ in range(STEPS):
            depth = (sample(depth, reads) * weights).sum(dim=1, keepdim=True) + self.b
        return depth

    def _normalize(
        self,
        affinity: Float[Tensor, "batch 8 height width"],
        shifts: Float[Tensor, "batch 8 2 height width"],
        confidence: Float[Tensor, "batch 1 height width"],
    ) -> Float[Tensor, "batch 8 height width"]:
        """TGASS weighted by confidence: absolute values that sum to at most 1."""
        affinity = torch.tanh(affinity / 100) / (self.aff_scale_const + 1e-8)
        # The weights were trained with confidence read at pixel + shift, without the tap's place
        # in the kernel that the depth itself is read with; the paper has both at the same place.
        read = sample(confidence, bilinear_reads(shifts.detach())) * self.w_conf + self.b
        affinity = affinity * read
        total = affinity.abs().sum(dim=1, keepdim=True) + 1e-4
        return affinity / total.clamp(min=1)


def _insert_center(
    around: Float[Tensor, "batch 8 *rest"], center: Float[Tensor, "batch 1 *rest"]
) -> Float[Tensor, "batch taps *rest"]:
    before, after = around.chunk(2, dim=1)
    return torch.cat((before, center, after), dim=1)
