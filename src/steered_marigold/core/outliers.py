"""Which measurements to believe, and a fit of scale and shift that wrong ones do not move."""

import math

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import cKDTree
from torch import Tensor

from steered_marigold.core.alignment import ScaleShift, fit_scale_shift

# sigma of a normal distribution = 1.4826 * its median absolute deviation
MAD_TO_SIGMA = 1.4826
REWEIGHTINGS = 8
# affine-invariant depth that is usually the camera's own place: NYUv2's 2 % percentile of depth is
# 0.3 of the way from there to its 98 % percentile. As weighty as this share of a measurement.
ORIGIN = -0.3
ORIGIN_WEIGHT = 0.1
# relative error of a prediction that is nobody's fault
LEAST_ERROR = 0.03
# a measurement this many spreads from the prior is questioned, and needs neighbours that agree
GATE = 1.5
# how far a prior's edge may lie from the true one, as a share of the image's diagonal
EDGE_SHIFT = 0.013
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
    """As `fit_scale_shift`, for positive targets and a source in [0, 1], by iteratively
    reweighted least squares. Raises NoMeasurementsError likewise.

    The error is relative, (fit - target) / target, with Cauchy weights 1 / (1 + (error / sigma)^2)
    and sigma from the median absolute error of each round (Holland and Welsch 1977). The slope is
    symmetric: sensors with a range see near depth only, and least squares would make far depth
    too near (truncated regression). One more equation of little weight, fit(ORIGIN) = 0, decides
    what a handful of measurements leaves open.
    """
    keep, s = mask.flatten(1), source.flatten(1)
    t = torch.where(keep, target.flatten(1), 1.0)
    relative = keep / t**2 if confidence is None else keep * confidence.flatten(1) / t**2
    depth_range = ((keep * t).sum(1) / (keep * (s - ORIGIN)).sum(1))[:, None]
    pull = ORIGIN_WEIGHT / depth_range**2
    pulled = F.pad(s, (0, 1), value=ORIGIN), F.pad(t, (0, 1)), F.pad(keep, (0, 1), value=True)
    fit = fit_scale_shift(s, t, keep, weights=relative)
    for _ in range(REWEIGHTINGS):
        error = ((fit.apply(s) - t) / t).abs()
        middle = torch.where(keep, error, torch.nan).nanmedian(dim=1, keepdim=True).values
        sigma = MAD_TO_SIGMA * middle.clamp(min=LEAST_ERROR)
        weights = torch.cat([relative / (1 + (error / sigma) ** 2), pull], dim=1)
        fit = fit_scale_shift(*pulled, weights=weights, symmetric=True)
    return fit


def trusted_measurements(
    prior: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> Bool[Tensor, "height width"]:
    """The measurements to believe, given a positive metric prior [m].

    The prior alone cannot tell a wrong measurement from a right one that it did not foresee, so
    a measurement far from it, and from all of it nearby (its edges are a little misplaced), is
    dropped only if its nearest neighbours do not agree with it either, in depth or in distance
    from the prior: flying pixels and outliers stand alone. Both gates widen with the spread found
    in the data. Four measurements or fewer are believed.
    """
    y, x = mask.nonzero(as_tuple=True)
    if len(y) <= 4:
        return mask
    measured, expected = sparse_depth[y, x].log(), prior.log()
    expected = expected + (measured - expected[y, x]).median()
    residual = measured - expected[y, x]
    spread = MAD_TO_SIGMA * residual.abs().median()
    window = 2 * round(EDGE_SHIFT * math.hypot(*mask.shape)) + 1
    least, most = (
        torch.from_numpy(extreme(expected.cpu().numpy(), window)).to(expected.device)
        for extreme in (ndimage.minimum_filter, ndimage.maximum_filter)
    )
    explained = (measured >= least[y, x]) & (measured <= most[y, x])
    questioned = (residual.abs() > GATE * spread) & ~explained
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
