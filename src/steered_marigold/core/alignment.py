"""Scale and shift between affine-invariant and metric depth (the paper's M)."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.errors import NoMeasurementsError


@dataclass(frozen=True)
class ScaleShift:
    """One affine map per batch element: target = scale * source + shift."""

    scale: Float[Tensor, " batch"]
    shift: Float[Tensor, " batch"]

    @property
    def increasing(self) -> Bool[Tensor, " batch"]:
        """False where the fit turned near into far: such a map must not be used silently."""
        return self.scale > 0

    def apply(self, values: Float[Tensor, "batch *rest"]) -> Float[Tensor, "batch *rest"]:
        """scale * values + shift, in the dtype and on the device of `values`."""
        shape = (-1,) + (1,) * (values.ndim - 1)
        return values * self.scale.to(values).view(shape) + self.shift.to(values).view(shape)

    def inverse(self) -> "ScaleShift":
        """The map from target to source. Undefined (inf, NaN) where scale is 0."""
        return ScaleShift(1 / self.scale, -self.shift / self.scale)

    def where(self, condition: Bool[Tensor, " batch"], other: "ScaleShift") -> "ScaleShift":
        """This map where `condition` holds, `other` elsewhere."""
        return ScaleShift(
            torch.where(condition, self.scale, other.scale),
            torch.where(condition, self.shift, other.shift),
        )


def fit_scale_shift(
    source: Float[Tensor, "batch *rest"],
    target: Float[Tensor, "batch *rest"],
    mask: Bool[Tensor, "batch *rest"],
    *,
    weights: Float[Tensor, "batch *rest"] | None = None,
    symmetric: bool = False,
) -> ScaleShift:
    """The (weighted) least-squares map from source to target over the masked elements.

    symmetric: the geometric mean of the slopes from source to target and from target to source
    (reduced major axis) instead: its slope does not flatten where only small targets were seen.

    Closed form, in float64 (on MPS, which has none, on the CPU). Where the masked source has
    fewer than 2 distinct values there is no shift to find: scale only, shift 0; if that one value
    is 0 there is no scale either: scale 1, shift the mean difference. The scale may come out <= 0
    (see `ScaleShift.increasing`): what to do then is the caller's decision.

    Raises NoMeasurementsError if the mask is empty for a batch element.
    """
    s, t, w = _prepare(source, target, mask, weights)
    total = w.sum(dim=1)
    mean_s, mean_t = (w * s).sum(dim=1) / total, (w * t).sum(dim=1) / total
    ds, dt = s - mean_s[:, None], t - mean_t[:, None]
    variance = (w * ds * ds).sum(dim=1)
    infinity = torch.full_like(s, torch.inf)
    used = w > 0
    constant = torch.where(used, s, infinity).amin(1) == torch.where(used, s, -infinity).amax(1)
    one = torch.ones_like(variance)
    covariance = (w * ds * dt).sum(dim=1)
    if symmetric:
        covariance = covariance.sign() * (variance * (w * dt * dt).sum(dim=1)).sqrt()
    scale = covariance / torch.where(constant, one, variance)
    affine = ScaleShift(scale, mean_t - scale * mean_s)
    zero = mean_s == 0
    ratio = torch.where(zero, one, mean_t / torch.where(zero, one, mean_s))
    proportional = ScaleShift(ratio, torch.where(zero, mean_t - mean_s, torch.zeros_like(one)))
    return affine.where(~constant, proportional)


def ratio_of_means(
    source: Float[Tensor, "batch *rest"],
    target: Float[Tensor, "batch *rest"],
    mask: Bool[Tensor, "batch *rest"],
) -> ScaleShift:
    """Scale = mean(target) / mean(source) over the mask, shift 0: the authors' way out when the
    least-squares scale is <= 0. A source of mean 0 gives scale 1.

    Raises NoMeasurementsError if the mask is empty for a batch element.
    """
    s, t, w = _prepare(source, target, mask, None)
    mean_s, mean_t = (w * s).sum(dim=1), (w * t).sum(dim=1)
    one = torch.ones_like(mean_s)
    scale = torch.where(mean_s == 0, one, mean_t / torch.where(mean_s == 0, one, mean_s))
    return ScaleShift(scale, torch.zeros_like(scale))


def _prepare(
    source: Tensor, target: Tensor, mask: Tensor, weights: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Flat float64 source, target and weights, 0 outside the mask."""
    device = torch.device("cpu") if source.device.type == "mps" else source.device
    keep = mask.flatten(1).to(device)
    w = keep.double() if weights is None else weights.flatten(1).to(device).double() * keep
    if not bool((w > 0).any(dim=1).all()):
        raise NoMeasurementsError("scale and shift need at least one measurement per image")
    zero = torch.zeros((), dtype=torch.float64, device=device)
    s = torch.where(keep, source.flatten(1).to(device).double(), zero)
    t = torch.where(keep, target.flatten(1).to(device).double(), zero)
    return s, t, w
