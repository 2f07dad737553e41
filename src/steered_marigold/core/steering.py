"""Moving a predicted clean depth map towards the measurements (the paper, Eq. 11).

| code | paper |
|---|---|
| predicted | x0D = D(x0~), decoded prediction of the clean sample, in [-1, 1] |
| condition | c, mapped to the same units |
| anchors | P |
| target | x0D - phi1(x0D, P) + phi2(x0D, c, P) |
| strength | lambda_t |
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.alignment import fit_scale_shift, ratio_of_means
from steered_marigold.core.anchors import (
    Anchors,
    far_from_known,
    select_anchors,
    thin_measurements,
)
from steered_marigold.core.interpolation import ScatteredInterpolant, remembered_interpolant

ConditionAlignment = Literal["least_squares", "minmax"]


def normalise_condition(
    sparse_depth: Float[Tensor, "batch height width"], mask: Bool[Tensor, "batch height width"]
) -> Float[Tensor, "batch height width"]:
    """Measurements [m] mapped by their own minimum and maximum to [-1, 1]; 0 elsewhere.

    Measurements that are all equal map to 0.
    """
    infinity = torch.full_like(sparse_depth, torch.inf)
    low = torch.where(mask, sparse_depth, infinity).amin(dim=(1, 2), keepdim=True)
    high = torch.where(mask, sparse_depth, -infinity).amax(dim=(1, 2), keepdim=True)
    extent = high - low
    scaled = 2 * (sparse_depth - low) / torch.where(extent > 0, extent, 1.0) - 1
    return torch.where(mask & (extent > 0), scaled, 0.0)


def align_condition(
    condition: Float[Tensor, "batch height width"],
    predicted: Float[Tensor, "batch height width"],
    mask: Bool[Tensor, "batch height width"],
) -> Float[Tensor, "batch height width"]:
    """M(c, x0D): the condition in the prediction's units, by least squares over the mask.

    A fitted slope <= 0 is replaced by the ratio of means, as in the authors' run.
    """
    fit = fit_scale_shift(condition, predicted, mask)
    return fit.where(fit.increasing, ratio_of_means(condition, predicted, mask)).apply(condition)


def steering_target(
    predicted: Float[Tensor, "batch height width"],
    condition: Float[Tensor, "batch height width"],
    anchors: Anchors,
    interpolant: ScatteredInterpolant,
) -> Float[Tensor, "batch height width"]:
    """x0D - phi1 + phi2 for maps that share their anchors.

    phi1 and phi2 interpolate over the same positions and are linear in the values, so phi2 - phi1
    is one interpolation of the residual: c - x0D at known positions, 0 at the others.
    """
    x, y = anchors.points.unbind(dim=1)
    residual = (condition[:, y, x] - predicted[:, y, x]) * anchors.known
    return predicted + interpolant(residual)


def steering_update(
    prev_sample: Float[Tensor, "batch channels h w"],
    predicted_x0: Float[Tensor, "batch channels h w"],
    target_latents: Float[Tensor, "batch channels h w"],
    strength: Float[Tensor, ""],
) -> Float[Tensor, "batch channels h w"]:
    """x_{t-1} + lambda_t (E(target) - x0~): Eq. 11."""
    return prev_sample + strength * (target_latents - predicted_x0)


@dataclass
class Steering:
    """The measurements of a batch of images, ready to move predictions towards.

    sparse_depth [m] and mask are at the size of the decoded prediction; generators are CPU
    generators, one an image. Everything that does not
    change over the steps is computed once; with `redraw` the random anchors, and with them the
    triangulation, are new in every step, as in the authors' run.
    """

    sparse_depth: Float[Tensor, "batch height width"]
    mask: Bool[Tensor, "batch height width"]
    neighborhood_px: int
    anchor_fraction: float
    redraw: bool
    max_anchors: int | None
    condition_alignment: ConditionAlignment
    generators: Sequence[torch.Generator]
    device: torch.device
    _condition: Tensor = field(init=False)
    _known: Tensor = field(init=False)
    _far: Sequence[Tensor] = field(init=False)
    _anchors: list[tuple[Anchors, ScatteredInterpolant]] = field(init=False)

    def __post_init__(self) -> None:
        masks = self.mask.cpu()
        self._condition = normalise_condition(self.sparse_depth, self.mask).to(self.device)
        self._far = [far_from_known(m, self.neighborhood_px) for m in masks]
        if self.max_anchors is not None:
            masks = torch.stack([thin_measurements(m, self.max_anchors) for m in masks])
        self._known = masks
        self._draw()

    def _draw(self) -> None:
        self._anchors = []
        for known, far, generator in zip(self._known, self._far, self.generators, strict=True):
            anchors = select_anchors(
                known, far, anchor_fraction=self.anchor_fraction, generator=generator
            )
            height, width = known.shape
            build = ScatteredInterpolant if self.redraw else remembered_interpolant
            interpolant = build(anchors.points, (height, width)).to(self.device)
            on_device = Anchors(anchors.points.to(self.device), anchors.known.to(self.device))
            self._anchors.append((on_device, interpolant))

    def target(
        self, predicted: Float[Tensor, "members height width"], step: int
    ) -> Float[Tensor, "members height width"]:
        """The map to steer towards, for the members of each image in turn."""
        if self.redraw and step > 0:
            self._draw()
        members = len(predicted) // len(self._condition)
        condition = self._condition.repeat_interleave(members, dim=0)
        if self.condition_alignment == "least_squares":
            mask = self._known.to(self.device).repeat_interleave(members, dim=0)
            condition = align_condition(condition, predicted, mask)
        maps = (torch.split(m, members) for m in (predicted, condition))
        images = zip(*maps, self._anchors, strict=True)
        return torch.cat([steering_target(p, c, *anchors) for p, c, anchors in images])
