"""From affine-invariant members and measurements to the answer (the paper's last M, and ours)."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.alignment import (
    PositiveFit,
    ScaleShift,
    fit_positive,
    fit_scale_shift,
    ratio_of_means,
)
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise, agree_with_measurements
from steered_marigold.core.holes import expect_beyond, find_holes
from steered_marigold.core.outliers import Judgement, judge_measurements
from steered_marigold.core.uncertainty import (
    DEFAULT_NOISE,
    UncertaintyModel,
    estimate_uncertainty,
)

# a depth so many times farther than all that was measured, or nearer, is said to be beyond it
BEYOND = 2.0


@dataclass(frozen=True, kw_only=True)
class Finishing:
    """How a prediction becomes metric.

    robust: a positive fit with reweighting, and measurements that nothing supports are left out;
    else plain least squares on all of them. consistent: correct the fit to agree with the
    measurements.
    least_share: lower bound of depth, as a share of the median measured depth, so that a scene of
    another scale is bounded alike; None for none (then a plain fit may be negative).
    uncertainty: the calibrated model for an answer from `consistent`, or None: the spread of the
    members alone.
    """

    robust: bool
    consistent: bool
    least_share: float | None
    uncertainty: UncertaintyModel | None = None


def finish(
    members: Float[Tensor, "members height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    settings: Finishing,
    *,
    noise: SensorNoise,
    assumed_noise: SensorNoise = DEFAULT_NOISE,
    confidence: Float[Tensor, "height width"] | None = None,
    image: Float[Tensor, "3 height width"] | None = None,
) -> DepthCompletion:
    """The completion of one image, batch axis 1.

    members: affine-invariant depth in [0, 1] of each ensemble member, at the measurements' size.
    Each is fitted to the measurements [m] on its own; the answer is their median. noise: how
    closely the answer meets the measurements. assumed_noise: of a measurement that is met exactly,
    for the uncertainty, which is never 0; to DEFAULT_NOISE belong the steps of the file, if known,
    in metres divided by the square root of 12.
    """
    members = members.float()
    measured = sparse_depth, valid_mask, confidence
    fit, rejected, positive = _fit(members, *measured, robust=settings.robust)
    metric = fit.apply(members)
    prior = median(metric)
    spread = median((metric - prior).abs()) if len(members) > 1 else None
    affine = median(members)[None]
    if len(members) > 1:
        fit, rejected, positive = _fit(affine, *measured, robust=settings.robust)
    floored = torch.zeros_like(valid_mask)
    if settings.least_share is not None:
        least = settings.least_share * sparse_depth[valid_mask].median()
        floored, prior = prior < least, torch.maximum(prior, least)
    judged = Judgement(valid_mask, torch.zeros_like(valid_mask))
    if settings.robust:
        judged = judge_measurements(prior, sparse_depth, valid_mask)
    depth, trusted, uncertainty = prior, judged.trusted, spread
    if settings.consistent or settings.uncertainty is not None:
        holes = find_holes(prior, sparse_depth, trusted)
    if settings.consistent:
        prior = expect_beyond(prior, holes)
        depth = agree_with_measurements(
            prior, sparse_depth, trusted, noise=noise, confidence=confidence, image=image
        )
    if settings.uncertainty is not None:
        doubt = None if positive is None else positive.doubt(affine)[0]
        uncertainty = estimate_uncertainty(
            settings.uncertainty,
            prior,
            depth,
            sparse_depth,
            trusted,
            holes,
            doubt,
            assumed_noise if noise.exact else noise,
        )
        # the truth may be what was measured, what is answered, or another
        contradiction = torch.where(judged.doubted, (sparse_depth - depth).abs() / 2, 0.0)
        uncertainty = torch.maximum(uncertainty, contradiction)
    return DepthCompletion(
        depth=depth[None],
        uncertainty=None if uncertainty is None else uncertainty[None],
        affine_depth=affine,
        scale=fit.scale.float(),
        shift=fit.shift.float(),
        slope_rejected=rejected,
        measured=valid_mask[None],
        trusted=trusted[None],
        floored=floored[None],
        beyond_range=_beyond(depth, sparse_depth, trusted)[None],
    )


def median(members: Float[Tensor, "members *shape"]) -> Float[Tensor, "*shape"]:
    """The median over members; of an even number the mean of the middle two."""
    if len(members) == 1:
        return members[0]
    ordered = members.sort(dim=0).values
    return (ordered[(len(members) - 1) // 2] + ordered[len(members) // 2]) / 2


def _fit(
    members: Float[Tensor, "members height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    confidence: Float[Tensor, "height width"] | None,
    *,
    robust: bool,
) -> tuple[ScaleShift, Bool[Tensor, " members"], PositiveFit | None]:
    """Each member's scale and shift, where a slope <= 0 gave way to the ratio of means, and what
    the robust fit doubts.
    """
    if robust:
        positive = fit_positive(members, sparse_depth, valid_mask, confidence=confidence)
        return positive.map, ~positive.map.increasing, positive
    source = members.flatten(1)
    target, mask = (x.flatten().expand_as(source) for x in (sparse_depth, valid_mask))
    weights = None if confidence is None else confidence.flatten().expand_as(source)
    usable = mask if weights is None else mask & (weights > 0)
    fit = fit_scale_shift(source, target, usable, weights=weights)
    return fit.where(fit.increasing, ratio_of_means(source, target, usable)), ~fit.increasing, None


def _beyond(
    depth: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
) -> Bool[Tensor, "height width"]:
    """Where depth is BEYOND times farther, or nearer, than all trusted measurements."""
    if not bool(trusted.any()):
        return torch.ones_like(trusted)
    measured = sparse_depth[trusted]
    return (depth > BEYOND * measured.max()) | (depth < measured.min() / BEYOND)


def without_measurements(members: Float[Tensor, "members height width"]) -> DepthCompletion:
    """Plain affine-invariant depth as an answer: `metric` is False."""
    affine = median(members.float())[None]
    nothing = torch.zeros_like(affine, dtype=torch.bool)
    return DepthCompletion(
        depth=affine, affine_depth=affine, measured=nothing, trusted=nothing, metric=False
    )
