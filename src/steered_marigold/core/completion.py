"""The answer of a depth completion: a record, data only."""

from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True)
class DepthCompletion:
    """Dense depth for a batch of images, at the size of the sparse depth that was given.

    depth: metric depth [m], z along the optical axis, finite; in [0, 1] if not `metric`.
    uncertainty: expected absolute error [m] (one standard measure per pixel), or None where the
        method has no estimate of it.
    affine_depth: affine-invariant depth in [0, 1] as the diffusion model gave it, or None for
        methods that have none.
    scale, shift: [m] and [m], metric = scale * affine_depth + shift; None without affine_depth.
    slope_rejected: True where the least-squares scale was <= 0 and the ratio of means was used.
    measured: True where a measurement was given.
    trusted: True where a measurement was given and believed.
    floored: True where depth was raised to the method's positive minimum.
    metric: False only when nothing was measured and the caller asked for an answer all the same.
    """

    depth: Float[Tensor, "batch height width"]
    measured: Bool[Tensor, "batch height width"]
    trusted: Bool[Tensor, "batch height width"]
    uncertainty: Float[Tensor, "batch height width"] | None = None
    affine_depth: Float[Tensor, "batch height width"] | None = None
    scale: Float[Tensor, " batch"] | None = None
    shift: Float[Tensor, " batch"] | None = None
    slope_rejected: Bool[Tensor, " batch"] | None = None
    floored: Bool[Tensor, "batch height width"] | None = None
    metric: bool = True
