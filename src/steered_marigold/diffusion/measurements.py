"""Measurements on the way from the sensor's grid to the grid on which the model works."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError


def check_measurements(
    sparse_depth: Tensor | Sequence[Tensor],
    valid_mask: Tensor | Sequence[Tensor] | None,
    images: int,
    size: tuple[int, int],
) -> tuple[Tensor, Tensor]:
    """(sparse_depth, valid_mask) as [images, height, width] float32 [m] and bool, on the CPU.

    Without a mask, finite and positive values count as measured. Raises SizeMismatchError if the
    measurements do not fit the images, InputError for values that are masked valid and are not
    finite and positive, NoMeasurementsError for an image without any.
    """
    depth = stack_maps(sparse_depth).float()
    measurable = torch.isfinite(depth) & (depth > 0)
    mask = measurable if valid_mask is None else stack_maps(valid_mask).bool()
    for name, tensor in (("sparse_depth", depth), ("valid_mask", mask)):
        if tuple(tensor.shape) != (images, *size):
            raise SizeMismatchError(
                f"{name} is {list(tensor.shape)}, but the image asks for {[images, *size]}"
            )
    if bool((mask & ~measurable).any()):
        raise InputError("sparse_depth must be finite and positive wherever valid_mask is True")
    empty = (~mask.flatten(1).any(dim=1)).nonzero().flatten().tolist()
    if empty:
        raise NoMeasurementsError(
            f"no valid measurement for image {empty[0]} of the batch; "
            "for depth without scale pass sparse_depth=None"
        )
    return torch.where(mask, depth, 0.0), mask


def stack_maps(maps: Tensor | Sequence[Tensor]) -> Tensor:
    """One map or several as [batch, height, width] on the CPU."""
    tensor = torch.stack([torch.as_tensor(m) for m in maps]) if not torch.is_tensor(maps) else maps
    return (tensor[None] if tensor.ndim == 2 else tensor).detach().cpu()


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
