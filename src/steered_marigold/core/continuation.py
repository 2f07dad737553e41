"""What is told to a U-Net that continues into holes what is known around them."""

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.alignment import fit_positive
from steered_marigold.core.distance import distance_to
from steered_marigold.core.interpolation import push_pull
from steered_marigold.core.outliers import trusted_measurements

# [px] of the processing grid; a cell counts as known if a measurement is so near to all of it
REACH_PX = 6.0
# the model's units are [-1, 1]; depth a little outside is still encoded faithfully
LIMIT = 1.1


def told_depth(
    predicted: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> tuple[Float[Tensor, "height width"], Bool[Tensor, "height width"]]:
    """(the prediction moved to the measurements [m] that are believed, which those are).

    predicted: in the model's units, [-1, 1]. Scale and shift between the two are fitted robustly,
    then the rest of the difference is spread from the measurements over the gaps between them.
    """
    affine = (predicted[None] + 1) / 2
    fit = fit_positive(affine, sparse_depth, valid_mask).map
    metric = fit.apply(affine)[0]
    trusted = trusted_measurements(metric, sparse_depth, valid_mask)
    in_units = 2 * fit.inverse().apply(sparse_depth[None])[0] - 1
    rest = torch.where(trusted, in_units.clamp(-LIMIT, LIMIT) - predicted, 0.0)
    told = predicted + push_pull(rest, trusted.to(rest))
    return told.clamp(-LIMIT, LIMIT), trusted


def known_cells(trusted: Bool[Tensor, "height width"], cell: int) -> Bool[Tensor, "rows columns"]:
    """True for the cells of cell x cell pixels that a measurement is near to."""
    distance = distance_to(trusted, cap=math.ceil(REACH_PX) + 1)
    return F.max_pool2d(distance[None, None], cell)[0, 0] <= REACH_PX
