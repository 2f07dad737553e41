"""From affine-invariant members and measurements to the answer (the paper's last M, and ours)."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.alignment import ScaleShift, fit_scale_shift, ratio_of_means
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise, agree_with_measurements
from steered_marigold.core.outliers import fit_scale_shift_robust, trusted_measurements
from steered_marigold.core.uncertainty import UncertaintyModel, estimate_uncertainty

# measurements that the robust fit reads, evenly spread over all; more change nothing
MAX_ROBUST = 20_000


@dataclass(frozen=True, kw_only=True)
class Finishing:
    """How a prediction becomes metric.

    robust: fit with reweighting and leave out measurements that nothing supports; else plain
    least squares on all of them. consistent: correct the fit to agree with the measurements.
    minimum_depth: positive lower bound [m], or None for none (then depth may be negative).
    uncertainty: the calibrated model for an answer from `consistent`, or None: the spread of the
    members alone.
    """

    robust: bool
    consistent: bool
    minimum_depth: float | None
    uncertainty: UncertaintyModel | None = None


def finish(
    members: Float[Tensor, "members height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    settings: Finishing,
    *,
    noise: SensorNoise,
    confidence: Float[Tensor, "height width"] | None = None,
    image: Float[Tensor, "3 height width"] | None = None,
) -> DepthCompletion:
    """The completion of one image, batch axis 1.

    members: affine-invariant depth in [0, 1] of each ensemble member, at the measurements' size.
    Each is fitted to the measurements [m] on its own; the answer is their median.
    """
    members = members.float()
    fit, rejected = _fit(members, sparse_depth, valid_mask, settings.robust, confidence)
    metric = fit.apply(members)
    depth = median(metric)
    spread = median((metric - depth).abs()) if len(members) > 1 else None
    affine = median(members)[None]
    overall, overall_rejected = (
        (fit, rejected)
        if len(members) == 1
        else _fit(affine, sparse_depth, valid_mask, settings.robust, confidence)
    )
    floored = torch.zeros_like(valid_mask)
    if settings.minimum_depth is not None:
        floored = depth < settings.minimum_depth
        depth = depth.clamp(min=settings.minimum_depth)
    trusted = valid_mask
    if settings.robust:
        trusted = trusted_measurements(depth, sparse_depth, valid_mask)
    prior = depth
    if settings.consistent:
        depth = agree_with_measurements(
            prior, sparse_depth, trusted, noise=noise, confidence=confidence, image=image
        )
    uncertainty = spread
    if settings.uncertainty is not None:
        uncertainty = estimate_uncertainty(
            settings.uncertainty, prior, depth, sparse_depth, trusted, spread, noise
        )
    return DepthCompletion(
        depth=depth[None],
        uncertainty=None if uncertainty is None else uncertainty[None],
        affine_depth=affine,
        scale=overall.scale.float(),
        shift=overall.shift.float(),
        slope_rejected=overall_rejected,
        measured=valid_mask[None],
        trusted=trusted[None],
        floored=floored[None],
    )


def median(members: Float[Tensor, "members *shape"]) -> Float[Tensor, "*shape"]:
    """The median over members; of an even number the mean of the middle two."""
    ordered = members.sort(dim=0).values
    return (ordered[(len(members) - 1) // 2] + ordered[len(members) // 2]) / 2


def _fit(
    members: Float[Tensor, "members height width"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    robust: bool,
    confidence: Float[Tensor, "height width"] | None,
) -> tuple[ScaleShift, Bool[Tensor, " members"]]:
    """Each member's scale and shift, and where a slope <= 0 gave way to the ratio of means."""
    usable = valid_mask if confidence is None else valid_mask & (confidence > 0)
    where = usable.flatten().nonzero()[:, 0]
    if robust and len(where) > MAX_ROBUST:
        where = where[torch.linspace(0, len(where) - 1, MAX_ROBUST, device=where.device).long()]
    source = members.flatten(1)[:, where]
    target = sparse_depth.flatten()[where].expand_as(source)
    weights = None if confidence is None else confidence.flatten()[where].expand_as(source)
    mask = torch.ones_like(source, dtype=torch.bool)
    if robust:
        fit = fit_scale_shift_robust(source, target, mask, confidence=weights)
    else:
        fit = fit_scale_shift(source, target, mask, weights=weights)
    return fit.where(fit.increasing, ratio_of_means(source, target, mask)), ~fit.increasing


def without_measurements(members: Float[Tensor, "members height width"]) -> DepthCompletion:
    """Plain affine-invariant depth as an answer: `metric` is False."""
    affine = median(members.float())[None]
    nothing = torch.zeros_like(affine, dtype=torch.bool)
    return DepthCompletion(
        depth=affine, affine_depth=affine, measured=nothing, trusted=nothing, metric=False
    )
