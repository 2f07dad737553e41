"""Which measurements to believe, and a fit of scale and shift that wrong ones do not move."""

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree
from torch import Tensor

from steered_marigold.core.alignment import ScaleShift, fit_scale_shift

# sigma of a normal distribution = 1.4826 * its median absolute deviation
MAD_TO_SIGMA = 1.4826
REWEIGHTINGS = 8
# a measurement this many spreads from the prior is questioned, and needs neighbours that agree
GATE = 1.5
NEIGHBOURS = 8
AGREEING = 2
# least log-depth difference that counts as agreement: 5 % of depth
LEAST_TOLERANCE = 0.05


def fit_scale_shift_robust(
    source: Float[Tensor, "batch *rest"],
    target: Float[Tensor, "batch *rest"],
    mask: Bool[Tensor, "batch *rest"],
    *,
    confidence: Float[Tensor, "batch *rest"] | None = None,
) -> ScaleShift:
    """As `fit_scale_shift`, for positive targets, by iteratively reweighted least squares.

    The error is relative, (fit - target) / target, with Cauchy weights 1 / (1 + (error / sigma)^2)
    and sigma from the median absolute error of each round (Holland and Welsch 1977).
    """
    safe = torch.where(mask, target, 1.0)
    relative = (1.0 if confidence is None else confidence) / safe**2
    fit = fit_scale_shift(source, target, mask, weights=relative)
    for _ in range(REWEIGHTINGS):
        error = (fit.apply(source) - safe) / safe
        absolute = torch.where(mask, error.abs(), torch.nan).flatten(1)
        sigma = MAD_TO_SIGMA * absolute.nanmedian(dim=1).values.clamp(min=1e-4)
        scaled = error / sigma.view(-1, *[1] * (error.ndim - 1))
        fit = fit_scale_shift(source, target, mask, weights=relative / (1 + scaled**2))
    return fit


def trusted_measurements(
    prior: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> Bool[Tensor, "height width"]:
    """The measurements to believe, given a positive metric prior [m].

    The prior alone cannot tell a wrong measurement from a right one that it did not foresee, so
    a measurement far from it is dropped only if its nearest neighbours do not agree with it
    either, in depth or in distance from the prior: flying pixels and outliers stand alone.
    Both gates widen with the spread found in the data. Four measurements or fewer are believed.
    """
    y, x = mask.nonzero(as_tuple=True)
    if len(y) <= 4:
        return mask
    measured = sparse_depth[y, x].log()
    residual = measured - prior[y, x].log()
    residual = residual - residual.median()
    spread = MAD_TO_SIGMA * residual.abs().median()
    questioned = residual.abs() > GATE * spread
    if not bool(questioned.any()):
        return mask
    points = torch.stack((y, x), dim=1).cpu().numpy().astype(np.float64)
    tree = cKDTree(points)
    count = min(NEIGHBOURS, len(points) - 1)
    # how much neighbours differ where nothing is wrong, from an even sample
    sample = np.unique(np.linspace(0, len(points) - 1, 2000).astype(np.int64))
    nearest = torch.from_numpy(tree.query(points[sample], 2)[1][:, 1]).to(residual.device)
    usual = (residual[torch.from_numpy(sample).to(residual.device)] - residual[nearest]).abs()
    tolerance = torch.clamp(3 * usual.median(), min=LEAST_TOLERANCE)
    ask = questioned.nonzero()[:, 0]
    around = tree.query(points[ask.cpu().numpy()], count + 1, workers=-1)[1][:, 1:]
    neighbours = torch.from_numpy(around).to(residual.device)
    same_depth = (measured[ask, None] - measured[neighbours]).abs() < tolerance
    same_offset = (residual[ask, None] - residual[neighbours]).abs() < tolerance
    alone = (same_depth | same_offset).sum(dim=1) < min(AGREEING, count)
    trusted = mask.clone()
    trusted[y[ask[alone]], x[ask[alone]]] = False
    return trusted
