"""How far a depth map is from the truth, image by image.

| field | symbol | definition over the N pixels of the mask, prediction d, truth g |
|---|---|---|
| abs_rel | REL | mean of abs(d - g) / g |
| delta1, delta2, delta3 | delta_k | share of max(d / g, g / d) < 1.25^k |
| rmse_m | RMSE [m] | root of the mean of (d - g)^2 |
| mae_m | MAE [m] | mean of abs(d - g) |
| irmse_per_km, imae_per_km | iRMSE, iMAE [1/km] | the same for 1 / d and 1 / g, as KITTI has it |

`seam_step` looks at the border of the known area, and `uncertainty_errors` and `uncertainty_curves`
at what a method says of its own errors.

A data set's figure is the mean over its images, each image counting once (as in the paper).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.special import ndtri
from scipy.stats import rankdata
from torch import Tensor

from steered_marigold.errors import InputError

NORMAL_90 = 1.645
"""90 % of a normal distribution lies within this many standard deviations of its mean."""
COVERAGE_LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
DROPPED_SHARES = tuple(i / 20 for i in range(20))

_SMOOTH_STEP = 0.05  # steps of the true log depth from here on are edges
_LEAST_FOURS = 30  # the mean of fewer says nothing of a border
_LEAST_DEPTH_M = 1e-3  # for the logarithm of a prediction


@dataclass(frozen=True, kw_only=True)
class DepthErrors:
    """The errors of one image, or their mean over images; see the table of this module.

    irmse_per_km and imae_per_km are infinite where a prediction is not positive.
    """

    abs_rel: float
    delta1: float
    delta2: float
    delta3: float
    rmse_m: float
    mae_m: float
    irmse_per_km: float
    imae_per_km: float


@dataclass(frozen=True, kw_only=True)
class UncertaintyErrors:
    """How well a stated uncertainty describes the errors of one image.

    spearman: rank correlation of uncertainty and absolute error; 0 if one of them is constant.
    ause: area under the sparsification error curve (Ilg et al., ECCV 2018), 0 is perfect. Pixels
        are dropped from the most uncertain on; the curve is the MAE of the rest less the MAE that
        dropping the largest errors would leave, divided by the MAE of all pixels. The area is its
        mean over all fractions of pixels kept. Equally uncertain pixels share their mean error.
    coverage90: share of pixels with abs(error) <= NORMAL_90 * uncertainty. 0.9 is right for normal
        errors whose standard deviation is the uncertainty.
    """

    spearman: float
    ause: float
    coverage90: float


@dataclass(frozen=True, kw_only=True)
class UncertaintyCurves:
    """What UncertaintyErrors sum up, as curves.

    coverage: share of pixels with abs(error) within the central interval of a normal distribution
        with each of COVERAGE_LEVELS. by_uncertainty: MAE of the pixels that are left when each of
        DROPPED_SHARES of them, the most uncertain first, is dropped, over the MAE of all pixels.
        by_error: the same when the largest errors go first; no order of dropping does better.
    """

    coverage: tuple[float, ...]
    by_uncertainty: tuple[float, ...]
    by_error: tuple[float, ...]


def depth_errors(
    prediction: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
    *,
    official: bool = False,
) -> DepthErrors:
    """Errors of one image over the pixels of the mask; depths in metres.

    A prediction that is not positive is an outlier of delta. `official` is the rule of the
    authors' script, in which a negative prediction has a negative ratio and counts as an inlier.

    Raises InputError if the mask is empty, the truth is not positive or a prediction not finite.
    """
    d, g = _masked(prediction, target, mask)
    error = d - g
    inverse_error = torch.where(d > 0, 1000 / d - 1000 / g, math.inf)
    ratio = torch.maximum(d / g, g / d)
    counts = (d > 0) | official
    return DepthErrors(
        abs_rel=_mean(error.abs() / g),
        delta1=_mean((ratio < 1.25) & counts),
        delta2=_mean((ratio < 1.25**2) & counts),
        delta3=_mean((ratio < 1.25**3) & counts),
        rmse_m=math.sqrt(_mean(error.square())),
        mae_m=_mean(error.abs()),
        irmse_per_km=math.sqrt(_mean(inverse_error.square())),
        imae_per_km=_mean(inverse_error.abs()),
    )


def uncertainty_errors(
    prediction: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> UncertaintyErrors:
    """How well `uncertainty` [m] describes the errors of one image over the pixels of the mask.

    Raises InputError as `depth_errors` does, and if an uncertainty is not finite.
    """
    sigma, error = _uncertainty_and_error(prediction, uncertainty, target, mask)
    return UncertaintyErrors(
        spearman=_spearman(sigma, error),
        ause=_ause(sigma, error),
        coverage90=float(np.mean(error <= NORMAL_90 * sigma)),
    )


def uncertainty_curves(
    prediction: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> UncertaintyCurves:
    """The curves of one image over the pixels of the mask; arguments as `uncertainty_errors`."""
    sigma, error = _uncertainty_and_error(prediction, uncertainty, target, mask)
    kept = [max(1, round((1 - share) * error.size)) - 1 for share in DROPPED_SHARES]
    total = float(error.mean()) or 1.0
    by_uncertainty, by_error = (curve[kept] / total for curve in _sparsification(sigma, error))
    widths = (float(ndtri((1 + level) / 2)) for level in COVERAGE_LEVELS)
    return UncertaintyCurves(
        coverage=tuple(float(np.mean(error <= width * sigma)) for width in widths),
        by_uncertainty=tuple(by_uncertainty.tolist()),
        by_error=tuple(by_error.tolist()),
    )


def seam_step(
    prediction: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
    known: Bool[Tensor, "height width"],
) -> float | None:
    """By how much the prediction jumps at the border of the known area, in log depth.

    Over all fours of pixels next to each other in a row or column, two in the known area and two
    outside: the mean absolute step of log depth between the middle two, less that of the steps
    one pixel further in on both sides, less the same of the truth. 0 is no seam; 0.01 a jump of
    about 1 % of the depth that the truth does not have. Only fours where the truth is known and
    has no edge (no step of 0.05 or more) count; None if they are fewer than 30.
    """
    known, mask = known.cpu(), mask.cpu()
    maps = [x.detach().cpu().double().where(mask, 1.0) for x in (prediction, target)]
    excess = []
    for dim in (0, 1):
        inside, valid = (x.unfold(dim, 4, 1) for x in (known, mask))
        sides = (inside[..., 0] == inside[..., 1]) & (inside[..., 2] == inside[..., 3])
        across = sides & (inside[..., 1] != inside[..., 2]) & valid.all(dim=-1)
        steps, true_steps = (
            x.clamp(min=_LEAST_DEPTH_M).log().unfold(dim, 4, 1)[across].diff().abs() for x in maps
        )
        smooth = (true_steps < _SMOOTH_STEP).all(dim=-1)
        more = (steps - true_steps)[smooth]
        excess.append(more[:, 1] - (more[:, 0] + more[:, 2]) / 2)
    joined = torch.cat(excess)
    return _mean(joined) if len(joined) >= _LEAST_FOURS else None


def exact_mean(values: Iterable[float]) -> float:
    """The mean, its sum rounded once (math.fsum): independent of the order.

    Raises InputError if there are no values.
    """
    values = list(values)
    if not values:
        raise InputError("the mean of no images is undefined; add at least one")
    return math.fsum(values) / len(values)


def _masked(
    prediction: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> tuple[Float[Tensor, " pixels"], Float[Tensor, " pixels"]]:
    """Both at the pixels of the mask, float64 on the CPU, checked."""
    if not bool(mask.any()):
        raise InputError("the mask holds no pixel, so there is nothing to measure")
    d, g = (x.detach().cpu().double()[mask.cpu()] for x in (prediction, target))
    if not bool(torch.isfinite(d).all()):
        raise InputError(f"the prediction holds {int((~d.isfinite()).sum())} values not finite")
    if not bool((g > 0).all()):
        raise InputError("the true depth must be positive wherever the mask is True")
    return d, g


def _uncertainty_and_error(
    prediction: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"],
    target: Float[Tensor, "height width"],
    mask: Bool[Tensor, "height width"],
) -> tuple[np.ndarray, np.ndarray]:
    """Uncertainty and absolute error [m] at the pixels of the mask, checked."""
    d, g = _masked(prediction, target, mask)
    sigma = uncertainty.detach().cpu().double()[mask.cpu()].numpy()
    if not np.isfinite(sigma).all():
        raise InputError("the uncertainty holds values that are not finite")
    return sigma, (d - g).abs().numpy()


def _mean(x: Tensor) -> float:
    return float(x.double().mean())


def _spearman(x: np.ndarray, y: np.ndarray) -> float:
    """Pearson correlation of the ranks, ties sharing their mean rank."""
    ranks = np.stack((rankdata(x), rankdata(y)))
    ranks -= ranks.mean(axis=1, keepdims=True)
    norms = np.sqrt((ranks**2).sum(axis=1))
    return float(ranks[0] @ ranks[1] / norms.prod()) if norms.all() else 0.0


def _ause(uncertainty: np.ndarray, error: np.ndarray) -> float:
    total = error.mean()
    if total == 0:
        return 0.0
    by_uncertainty, by_error = _sparsification(uncertainty, error)
    return float(np.mean(by_uncertainty - by_error) / total)


def _sparsification(uncertainty: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """MAE of the 1, 2, ... N surest pixels, and of the 1, 2, ... N with the least error."""
    _, group, size = np.unique(uncertainty, return_inverse=True, return_counts=True)
    shared = (np.bincount(group, weights=error) / size)[group]
    kept = np.arange(1, error.size + 1)
    by_uncertainty = np.cumsum(shared[np.argsort(group, kind="stable")]) / kept
    return by_uncertainty, np.cumsum(np.sort(error)) / kept
