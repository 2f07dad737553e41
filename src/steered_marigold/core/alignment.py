"""Scale and shift between affine-invariant and metric depth (the paper's M)."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.errors import NoMeasurementsError

# sigma of a normal distribution = 1.4826 * its median absolute deviation
MAD_TO_SIGMA = 1.4826
# Where depth 0 lies: metric = k (affine + origin). Over the tune frames, fitted to all of their
# depth, the origin is log-normal with this median and this standard deviation of its logarithm.
ORIGIN = 0.4
ORIGIN_SPREAD = 0.64
# the origins that are weighed against each other: 3.5 standard deviations to both sides and more
ORIGINS = torch.exp(torch.linspace(math.log(0.02), math.log(8.0), 33, dtype=torch.float64))
# What measurements say of the origin, however many they are: errors of a prediction are alike over
# whole objects. Both, and FEW, chosen on the tune frames by the error in holes of all protocols.
INDEPENDENT = 4.0
SLOPE_VARIANCE = 0.5
# so many measurements tell half of what ever more of them do
FEW = 10.0
# log-depth error of a prediction that is nobody's fault
LEAST_ERROR = 0.03
MOST = 5000  # measurements that are read; more change nothing
REWEIGHTINGS = 4  # a fifth moves the origin by less than the grid's step
_LEAST_SPREAD = 0.02  # of log depth; below it is a flat wall, or the sensor's noise


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
) -> ScaleShift:
    """The (weighted) least-squares map from source to target over the masked elements.

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
    scale = (w * ds * dt).sum(dim=1) / torch.where(constant, one, variance)
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


@dataclass(frozen=True)
class PositiveFit:
    """Robust scale and shift for which every affine depth in [0, 1] is a positive metric depth.

    map: the fit. weights: how probable each of ORIGINS is, and log_scales: the logarithm of the
    scale that goes with it, for each batch element.
    """

    map: ScaleShift
    weights: Float[Tensor, "batch origins"]
    log_scales: Float[Tensor, "batch origins"]

    def doubt(self, values: Float[Tensor, "batch *rest"]) -> Float[Tensor, "batch *rest"]:
        """Standard deviation of log depth at affine depths in [0, 1], for want of the origin.

        Small at the depths that were measured, large beyond them. Linear between 65 values.
        """
        steps = 64
        at = torch.linspace(0, 1, steps + 1, dtype=torch.float64, device=self.weights.device)
        logs = self.log_scales[..., None] + (at + ORIGINS.to(at)[:, None]).log()
        mean = (self.weights[..., None] * logs).sum(1, keepdim=True)
        table = (self.weights[..., None] * (logs - mean).square()).sum(1).sqrt().to(values)
        place = (values.flatten(1) * steps).clamp(0, steps)
        low = place.long().clamp(max=steps - 1)
        left, right = table.gather(1, low), table.gather(1, low + 1)
        return torch.lerp(left, right, place - low).view_as(values)


def fit_positive(
    sources: Float[Tensor, "batch *rest"],
    target: Float[Tensor, "*rest"],
    mask: Bool[Tensor, "*rest"],
    *,
    confidence: Float[Tensor, "*rest"] | None = None,
) -> PositiveFit:
    """Positive scale and shift from each of the sources, in [0, 1], to the positive targets.

    The link is log target = log k + log(source + origin), so depth stays positive wherever the
    source goes, and multiplying all targets multiplies k alone. For each of a grid of origins, k
    is the weighted mean, and its worth the sum of

        INDEPENDENT log spread + log(spread of the source's logs / the targets')^2 / (2 v)
        + log(origin / ORIGIN)^2 / (2 ORIGIN_SPREAD^2),   v = SLOPE_VARIANCE (1 - correlation^2)

    The first term is least squares. The second, the reduced major axis, asks for the slope that
    neither regression flattens: sensors with a range see near depth only, and least squares
    would make far depth too near (truncated regression). The third is the prior, which decides
    what a narrow range of depths leaves open. The answer is the mean of log origin over
    exp(-worth). Weights are Cauchy's, 1 / (1 + (error / sigma)^2), sigma from the median absolute
    error of each round (Holland and Welsch 1977). Of many measurements, MOST are read.

    Raises NoMeasurementsError if the mask is empty, or its confidence 0.
    """
    s, log_t, given = _read_evenly(sources, target, mask, confidence)
    origins = ORIGINS.to(s.device)
    log_s = (s[:, None] + origins[:, None]).log()
    offset = log_t - log_s
    prior = (origins / ORIGIN).log().square() / (2 * ORIGIN_SPREAD**2)
    best = prior.argmin().expand(len(s))
    log_k = offset.median(dim=2).values
    told = len(log_t) / (len(log_t) + FEW)
    rows = torch.arange(len(s), device=s.device)
    for _ in range(REWEIGHTINGS):
        error = (offset[rows, best] - log_k[rows, best, None]).abs()
        sigma = MAD_TO_SIGMA * error.median(dim=1, keepdim=True).values.clamp(min=LEAST_ERROR)
        w = (given / (1 + (error / sigma) ** 2))[:, None]
        w = w / w.sum(dim=2, keepdim=True)
        log_k = (w * offset).sum(dim=2)
        spread = (w * (offset - log_k[..., None]).square()).sum(dim=2).sqrt()
        worth = INDEPENDENT * spread.clamp(min=_LEAST_SPREAD).log() + _slope_worth(log_s, log_t, w)
        worth = told * worth + prior
        best = worth.argmin(dim=1)
    weights = torch.softmax(-worth, dim=1)
    origin = (weights * origins.log()).sum(dim=1).exp()
    scale = (w[:, 0] * (log_t - (s + origin[:, None]).log())).sum(dim=1).exp()
    return PositiveFit(ScaleShift(scale, scale * origin), weights, log_k)


def _read_evenly(
    sources: Tensor, target: Tensor, mask: Tensor, confidence: Tensor | None
) -> tuple[Float[Tensor, "batch n"], Float[Tensor, " n"], Float[Tensor, " n"]]:
    """At most MOST of what is masked: sources, log targets and confidence, float64."""
    device = torch.device("cpu") if sources.device.type == "mps" else sources.device
    usable = mask if confidence is None else mask & (confidence > 0)
    where = usable.flatten().nonzero()[:, 0]
    if len(where) == 0:
        raise NoMeasurementsError("scale and shift need at least one measurement per image")
    if len(where) > MOST:
        where = where[torch.linspace(0, len(where) - 1, MOST, device=where.device).long()]
    s = sources.flatten(1)[:, where].to(device).double().clamp(min=0)
    log_t = target.flatten()[where].to(device).double().log()
    given = torch.ones_like(target) if confidence is None else confidence
    return s, log_t, given.flatten()[where].to(device).double()


def _slope_worth(
    log_s: Float[Tensor, "batch origins n"],
    log_t: Float[Tensor, " n"],
    w: Float[Tensor, "batch 1 n"],
) -> Float[Tensor, "batch origins"]:
    """How far the reduced major axis of logs is from slope 1, for each origin, in `fit_positive`.

    w: adds up to 1.
    """
    ds = log_s - (w * log_s).sum(dim=2, keepdim=True)
    dt = log_t - (w * log_t).sum(dim=2, keepdim=True)
    spread_s, spread_t = ((w * x.square()).sum(dim=2).sqrt().clamp(min=1e-3) for x in (ds, dt))
    correlation = ((w * ds * dt).sum(dim=2) / (spread_s * spread_t)).clamp(0, 1)
    variance = SLOPE_VARIANCE * (1 - correlation**2) + _LEAST_SPREAD
    return (spread_s / spread_t).log().square() / (2 * variance)
