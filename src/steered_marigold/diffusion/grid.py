"""The processing grid: images as the model gets to see them, and measurements moved there."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.frame import as_array
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError

T = TypeVar("T")


@dataclass(frozen=True)
class Measured:
    """What was measured in a batch of images, on the CPU: depth [m], 0 where the mask is False."""

    sparse_depth: Float[Tensor, "images height width"]
    valid_mask: Bool[Tensor, "images height width"]


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

    @property
    def images(self) -> int:
        """How many images there are."""
        return len(self.pixels) // (1 + self.mirrored)

    @property
    def answers(self) -> int:
        """How many depth maps are sampled: every member's of every view."""
        return len(self.pixels) * self.members

    def of_each(self, values: Sequence[T]) -> list[T]:
        """One value for each view, from one for each image."""
        return [value for value in values for _ in range(1 + self.mirrored)]

    def on_grid(self, measured: Measured) -> Measured:
        """The measurements as points on each view's grid, see `move_to_grid`."""
        depth, mask = measured.sparse_depth, measured.valid_mask
        if self.mirrored:
            depth, mask = (torch.stack([m, m.flip(-1)], 1).flatten(0, 1) for m in (depth, mask))
        height, width = self.pixels.shape[-2:]
        inner = height - self.padding[0], width - self.padding[1]
        return Measured(*move_to_grid(depth, mask, inner, (height, width)))

    def upright(
        self, maps: Float[Tensor, "answers height width"]
    ) -> list[Float[Tensor, "members height width"]]:
        """The answers of all members for each image, none of them mirrored."""
        if not self.mirrored:
            return list(torch.split(maps, self.members))
        pairs = maps.view(-1, 2, self.members, *maps.shape[-2:])
        return [torch.cat([plain, mirrored.flip(-1)]) for plain, mirrored in pairs]


def stack_measured(
    sparse_depth: Any, valid_mask: Any | None, images: int, size: tuple[int, int]
) -> Measured:
    """Measurements [m] of arrays of any kind for a batch of images of `size` (height, width).

    Without a mask, finite and positive values count as measured. Raises SizeMismatchError if the
    measurements do not fit the images, InputError for values that are masked valid and are not
    finite and positive, NoMeasurementsError for an image without any.
    """
    depth = stack_maps("sparse_depth", sparse_depth, images, size).float()
    measurable = torch.isfinite(depth) & (depth > 0)
    mask = measurable
    if valid_mask is not None:
        mask = stack_maps("valid_mask", valid_mask, images, size).bool()
    if bool((mask & ~measurable).any()):
        raise InputError("`sparse_depth` must be finite and positive wherever `valid_mask` is True")
    empty = (~mask.flatten(1).any(dim=1)).nonzero().flatten().tolist()
    if empty:
        raise NoMeasurementsError(
            f"no valid measurement for image {empty[0]} of the batch; "
            "for depth without scale give `sparse_depth=None`"
        )
    return Measured(torch.where(mask, depth, 0.0), mask)


def stack_confidence(confidence: Any, images: int, size: tuple[int, int]) -> Tensor:
    """Weights of the measurements [images, height, width]; InputError unless all lie in 0..1."""
    weights = stack_maps("confidence", confidence, images, size).float()
    if not bool(((weights >= 0) & (weights <= 1)).all()):
        raise InputError("`confidence` must lie in 0..1; divide it by its largest value")
    return weights


def stack_maps(name: str, maps: Any, images: int, size: tuple[int, int]) -> Tensor:
    """One map or several as [images, height, width] on the CPU; SizeMismatchError for others."""
    parts = [as_array(name, m) for m in maps] if isinstance(maps, Sequence) else None
    array = as_array(name, maps) if parts is None else np.stack(parts)
    if array.ndim == 2:
        array = array[None]
    if array.shape != (images, *size):
        raise SizeMismatchError(
            f"`{name}` is {list(array.shape)}, but the image asks for {[images, *size]}"
        )
    return torch.from_numpy(np.ascontiguousarray(array))


def to_longer_side(
    images: Float[Tensor, "images 3 height width"], longer: int
) -> Float[Tensor, "images 3 h w"]:
    """Images whose longer side is so many pixels, or as they are for 0, as Marigold resizes them.

    Raises InputError for images so thin that nothing of their width would be left.
    """
    if longer == 0:
        return images
    size = [side * longer // max(images.shape[-2:]) for side in images.shape[-2:]]
    if 0 in size:
        height, width = images.shape[-2:]
        raise InputError(
            f"`image` of {width}x{height} cannot be brought to {longer} px: extreme aspect ratio"
        )
    return F.interpolate(images, size, mode="bilinear", antialias=True)


def pad(
    images: Float[Tensor, "batch channels height width"], align: int
) -> tuple[Float[Tensor, "batch channels h w"], tuple[int, int]]:
    """Images whose sides are multiples, their last row and column repeated; and how often [px]."""
    rows, columns = (-side % align for side in images.shape[-2:])
    return F.pad(images, (0, columns, 0, rows), mode="replicate"), (rows, columns)


def inner_part(
    maps: Float[Tensor, "batch channels h w"], padding: tuple[int, int]
) -> Float[Tensor, "batch channels height width"]:
    """Maps without the rows and columns that `pad` added."""
    height, width = (side - added for side, added in zip(maps.shape[-2:], padding, strict=True))
    return maps[..., :height, :width]


def move_to_grid(
    depth: Float[Tensor, "batch height width"],
    mask: Bool[Tensor, "batch height width"],
    size: tuple[int, int],
    padded: tuple[int, int],
) -> tuple[Float[Tensor, "batch h w"], Bool[Tensor, "batch h w"]]:
    """Measurements as points on another grid: nothing is blended, the nearest of a cell wins.

    size: the image's height and width there. padded: the grid's, with unmeasured pixels added at
    the right and the bottom.
    """
    image, y, x = mask.nonzero(as_tuple=True)
    row = ((y + 0.5) * size[0] / depth.shape[1]).long()
    column = ((x + 0.5) * size[1] / depth.shape[2]).long()
    cell = (image * padded[0] + row) * padded[1] + column
    grid = torch.full((len(depth) * padded[0] * padded[1],), torch.inf)
    grid.scatter_reduce_(0, cell, depth[image, y, x], "amin")
    grid = grid.view(len(depth), *padded)
    known = torch.isfinite(grid)
    return torch.where(known, grid, 0.0), known
