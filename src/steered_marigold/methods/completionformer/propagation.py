"""Non-local spatial propagation: Park et al., "Non-Local Spatial Propagation Network for Depth
Completion", ECCV 2020 (arXiv 2007.10042)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

STEPS = 6
NEIGHBOURS = 8


def modulated_deform_conv(
    x: Float[Tensor, "batch 1 height width"],
    offsets: Float[Tensor, "batch taps 2 height width"],
    modulation: Float[Tensor, "batch taps height width"],
    weight: Float[Tensor, "1 1 side side"],
    bias: Float[Tensor, " 1"],
) -> Float[Tensor, "batch 1 height width"]:
    """Deformable convolution v2 (Zhu et al., CVPR 2019, Eq. 1) of one channel, stride 1.

    Tap k, row-major in a kernel of odd side, contributes weight_k * modulation_k * x at the
    pixel's place + the tap's place in the kernel + offset_k. x is sampled bilinearly and is zero
    outside the image.

    offsets: (y, x) [px].
    """
    height, width = x.shape[2:]
    reach = weight.shape[-1] // 2
    steps = torch.arange(-reach, reach + 1, device=x.device)
    taps = torch.cartesian_prod(steps, steps).view(-1, 2, 1, 1)
    rows, columns = (torch.arange(size, device=x.device) for size in (height, width))
    pixels = torch.stack(torch.meshgrid(rows, columns, indexing="ij"))
    y, x_ = (pixels + taps + offsets).unbind(2)
    # grid_sample has the borders of the image, half a pixel beyond the centres, at -1 and 1
    grid = torch.stack(((2 * x_ + 1) / width - 1, (2 * y + 1) / height - 1), dim=-1)
    sampled = F.grid_sample(x, grid.flatten(1, 2), align_corners=False)
    weights = modulation * weight.view(-1, 1, 1)
    return (sampled.view_as(modulation) * weights).sum(dim=1, keepdim=True) + bias


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
        for _ in range(STEPS):
            depth = modulated_deform_conv(depth, shifts, affinity, self.w, self.b)
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
        one = torch.ones_like(confidence)
        read = [
            modulated_deform_conv(confidence, shift, one, self.w_conf, self.b)
            for shift in shifts.detach().chunk(NEIGHBOURS, dim=1)
        ]
        affinity = affinity * torch.cat(read, dim=1)
        total = affinity.abs().sum(dim=1, keepdim=True) + 1e-4
        return affinity / total.clamp(min=1)


def _insert_center(
    around: Float[Tensor, "batch 8 *rest"], center: Float[Tensor, "batch 1 *rest"]
) -> Float[Tensor, "batch taps *rest"]:
    before, after = around.chunk(2, dim=1)
    return torch.cat((before, center, after), dim=1)
