"""The answer of a depth completion: a record, data only."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, repr=False)
class DepthCompletion:
    """Dense depth for a batch of images, at the size of the sparse depth that was given.

    depth: metric depth [m], z along the optical axis, finite; in [0, 1] if not `metric`.
    uncertainty: standard deviation of the error [m]; where a preset has no calibrated model, the
        ensemble's median absolute deviation [m]; None where there is no estimate.
    affine_depth: affine-invariant depth in [0, 1] as the diffusion model gave it, or None for
        methods that have none.
    scale, shift: [m] and [m], metric = scale * affine_depth + shift; None without affine_depth.
    slope_rejected: True where the least-squares scale was <= 0 and the ratio of means was used.
    measured: True where a measurement was given.
    trusted: True where a measurement was given and believed.
    floored: True where depth was raised to the method's positive minimum.
    beyond_range: True where depth is more than twice as far as the farthest, or less than half as
        far as the nearest, trusted measurement; None for methods that do not say.
    exact_codec_steps, linear_codec_steps: steps of steering that went through the VAE, and through
        a linear map in its place.
    latents: clean depth latents of every member, where they were asked for.
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
    beyond_range: Bool[Tensor, "batch height width"] | None = None
    exact_codec_steps: int = 0
    linear_codec_steps: int = 0
    latents: Float[Tensor, "members channels h w"] | None = None
    metric: bool = True

    def summary(self) -> dict[str, str]:
        """The numbers of the whole batch in words, by name."""
        images, height, width = self.depth.shape
        said = {"size": f"{images} x {width}x{height} px"}
        known = self.depth[self.depth > 0]
        if not self.metric:
            said["depth"] = "relative, 0 to 1"
        elif known.numel():
            said["depth"] = f"{float(known.min()):.2f} to {float(known.max()):.2f} m"
        said["measured"] = f"{float(self.measured.float().mean()):.1%}"
        refused = int((self.measured & ~self.trusted).sum())
        if refused:
            said["not believed"] = f"{refused:,} px"
        if self.uncertainty is not None:
            unit = " m" if self.metric else ""
            said["median uncertainty"] = f"{float(self.uncertainty.median()):.3g}{unit}"
        for name in ("floored", "beyond_range"):
            mask = getattr(self, name)
            if mask is not None and mask.any():
                said[name.replace("_", " ")] = f"{int(mask.sum()):,} px"
        return said

    def __repr__(self) -> str:
        """Sizes and shares; the tensors would fill screens."""
        said = (f"{name} {value}" for name, value in self.summary().items())
        return f"DepthCompletion({', '.join(said)})"

    def _repr_html_(self) -> str:
        """Pictures and numbers, for notebooks."""
        # the one import upwards: notebooks look for this method, and the core draws nothing
        from steered_marigold.pictures.notebook import completion_html

        return completion_html(self)


def join_completions(parts: Sequence[DepthCompletion]) -> DepthCompletion:
    """One record for a batch from records of its parts, which have the same fields."""
    if len(parts) == 1:
        return parts[0]
    joined: dict[str, Any] = {}
    for field in fields(DepthCompletion):
        values = [getattr(part, field.name) for part in parts]
        joined[field.name] = torch.cat(values) if torch.is_tensor(values[0]) else values[0]
    return DepthCompletion(**joined)
