"""Images as the model gets to see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.continuation import known_cells, told_depth
from steered_marigold.core.finishing import median
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.denoising import Told
from steered_marigold.diffusion.measurements import move_to_grid

T = TypeVar("T")


@dataclass(frozen=True)
class Views:
    """The images of a batch on the processing grid, each followed by its mirror image if mirrored.

    pixels: in [-1, 1]. padding: rows at the bottom and columns at the right [px] that are none of
    the image. size: height and width of the images as they came. members: ensemble members that
    look at each view.
    """

    pixels: Float[Tensor, "views 3 h w"]
    padding: tuple[int, int]
    size: tuple[int, int]
    members: int
    mirrored: bool

    def of_each(self, values: Sequence[T]) -> list[T]:
        """One value for each view, from one for each image."""
        return [value for value in values for _ in range(1 + self.mirrored)]

    def on_grid(
        self, depth: Float[Tensor, "images height width"], mask: Bool[Tensor, "images height width"]
    ) -> tuple[Float[Tensor, "views h w"], Bool[Tensor, "views h w"]]:
        """Measurements as points on each view's grid, see `move_to_grid`."""
        if self.mirrored:
            depth, mask = (torch.stack([m, m.flip(-1)], 1).flatten(0, 1) for m in (depth, mask))
        height, width = self.pixels.shape[-2:]
        inner = height - self.padding[0], width - self.padding[1]
        return move_to_grid(depth, mask, inner, (height, width))

    def upright(
        self, maps: Float[Tensor, "answers height width"]
    ) -> list[Float[Tensor, "members height width"]]:
        """The answers of all members for each image, none of them mirrored."""
        if not self.mirrored:
            return list(torch.split(maps, self.members))
        pairs = maps.view(-1, 2, self.members, *maps.shape[-2:])
        return [torch.cat([plain, mirrored.flip(-1)]) for plain, mirrored in pairs]

    def tell(
        self,
        measured: tuple[Float[Tensor, "images height width"], Bool[Tensor, "images height width"]],
        estimate: Float[Tensor, "answers h w"],
        codec: DepthCodec,
    ) -> Told:
        """The measurements as latents, in the units of a first estimate, for every member."""
        maps, trusted = [], []
        for members, depth, mask in zip(
            torch.split(estimate.float(), self.members), *self.on_grid(*measured), strict=True
        ):
            told, believed = told_depth(median(members), depth.to(members), mask.to(members.device))
            maps.append(told)
            trusted.append(believed)
        latents = codec.encode(torch.stack(maps))
        cell = estimate.shape[-1] // latents.shape[-1]
        known = torch.stack([known_cells(mask, cell) for mask in trusted])[:, None]
        latents, known = (x.repeat_interleave(self.members, dim=0) for x in (latents, known))
        return Told(latents, known)
