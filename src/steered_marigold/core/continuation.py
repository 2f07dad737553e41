"""What is told to a U-Net that continues into holes what is known around them."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.alignment import fit_positive
from steered_marigold.core.anchors import thin_measurements
from steered_marigold.core.interpolation import remembered_interpolant
from steered_marigold.core.outliers import trusted_measurements

# [px] of the processing grid; a cell counts as known if a measurement is so near to all of it
REACH_PX = 6.0
# the model's units are [-1, 1]; depth a little outside is still encoded faithfully
LIMIT = 1.1
# interpolating more points than these changes nothing at the latents' resolution
MAX_POINTS = 4000


def told_depth(
    predicted: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> tuple[Float[Tensor, "height width"], Bool[Tensor, "height width"]]:
    """(the prediction moved to the measurements [m] that are believed, which those are).

    predicted: in the model's units, [-1, 1]. Scale and shift between the two are fitted robustly,
    then the rest of the difference is interpolated, as in steering (the paper, Eq. 10), over the
    measurements alone.
    """
    affine = (predicted[None] + 1) / 2
    fit = fit_positive(affine, sparse_depth, valid_mask).map
    metric = fit.apply(affine)[0]
    trusted = trusted_measurements(metric, sparse_depth, valid_mask)
    used = thin_measurements(trusted.cpu(), MAX_POINTS).nonzero()
    y, x = used.to(predicted.device).unbind(dim=1)
    measured = 2 * fit.inverse().apply(sparse_depth[None, y, x])[0] - 1
    shape = (predicted.shape[0], predicted.shape[1])
    interpolant = remembered_interpolant(used.flip(-1), shape).to(predicted.device)
    told = predicted + interpolant(measured.clamp(-LIMIT, LIMIT) - predicted[y, x])
    return told.clamp(-LIMIT, LIMIT), trusted


def known_cells(trusted: Bool[Tensor, "height width"], cell: int) -> Bool[Tensor, "rows columns"]:
    """True for the cells of cell x cell pixels that a measurement is near to."""
    distance = torch.from_numpy(ndimage.distance_transform_edt(~trusted.cpu().numpy()))
    farthest = F.max_pool2d(distance.float()[None, None], cell)[0, 0]
    return (farthest <= REACH_PX).to(trusted.device)
