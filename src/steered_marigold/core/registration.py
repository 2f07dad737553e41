"""From a depth sensor's coarser grid to the image's, when both see the same field of view."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from steered_marigold.errors import SizeMismatchError


@dataclass(frozen=True, kw_only=True)
class Registration:
    """Measurements on the image's grid.

    depth: [m], 0 where valid_mask is False.
    source: for each pixel the row-major index of its measurement in the sensor's grid, read only
        where valid_mask is True.
    """

    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    source: Int64[Tensor, "height width"]

    def carry(
        self, values: Float[Tensor, "sensor_height sensor_width"]
    ) -> Float[Tensor, "height width"]:
        """Another map of the sensor, such as its confidence, moved with the measurements."""
        moved = values.flatten()[self.source]
        return torch.where(self.valid_mask, moved, torch.zeros_like(moved))


def register_depth(
    depth: Float[Tensor, "sensor_height sensor_width"],
    valid_mask: Bool[Tensor, "sensor_height sensor_width"],
    size: tuple[int, int],
) -> Registration:
    """Moves each measurement [m] to the nearest pixel of an image of `size` (height, width).

    Both grids span the same field of view, so their outer pixel borders coincide. Nothing is
    blended or invented; where several measurements meet, the smallest depth wins, because it
    hides the others.

    Raises SizeMismatchError if the two differ in aspect ratio by more than a sensor pixel.
    """
    height, width = size
    rows, columns = depth.shape
    if min(abs(height * columns / width - rows), abs(width * rows / height - columns)) > 1:
        raise SizeMismatchError(
            f"the image is {width}x{height} but the depth map {columns}x{rows}: another aspect "
            "ratio, so not the same field of view; crop one to the other's"
        )
    indices = valid_mask.flatten().nonzero().squeeze(1)
    # the centre of a sensor pixel lies at (i + 1/2) of its grid, so in the image's at
    # (i + 1/2) height / rows; integer arithmetic keeps ties exact
    y = (2 * (indices // columns) + 1) * height // (2 * rows)
    x = (2 * (indices % columns) + 1) * width // (2 * columns)
    cells = y * width + x
    values = depth.flatten()[indices]

    nearest = values.new_full((height * width,), torch.inf)
    nearest.scatter_reduce_(0, cells, values, "amin")
    winners = values == nearest[cells]
    source = indices.new_full((height * width,), depth.numel())
    source.scatter_reduce_(0, cells[winners], indices[winners], "amin")

    hit = source < depth.numel()
    return Registration(
        depth=torch.where(hit, nearest, torch.zeros_like(nearest)).reshape(size),
        valid_mask=hit.reshape(size),
        source=torch.where(hit, source, torch.zeros_like(source)).reshape(size),
    )
