"""From a depth sensor's grid to the image's: of equal view, or of another camera."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn.functional import pad

from steered_marigold.core.geometry import project, unproject
from steered_marigold.errors import InputError, SizeMismatchError

_NEARER_BY, _SURROUNDED = 0.05, 5  # a pixel is hidden if this many of 8 neighbours are nearer
_LARGEST_GROWTH = 4.0  # of a sensor's pixel whose point lies right before the image's camera
_ROUNDING_PX = 1e-6
_NEARLY = 0.05  # share of the image that a crop may cost to be called nearly fitting


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
        raise SizeMismatchError(_advice(size, (rows, columns)))
    indices = valid_mask.flatten().nonzero().squeeze(1)
    # the centre of a sensor pixel lies at (i + 1/2) of its grid, so in the image's at
    # (i + 1/2) height / rows; integer arithmetic keeps ties exact
    y = (2 * (indices // columns) + 1) * height // (2 * rows)
    x = (2 * (indices % columns) + 1) * width // (2 * columns)
    return nearest_of_each(depth, indices, y * width + x, depth.flatten()[indices], size)


def register_depth_camera(
    depth: Float[Tensor, "sensor_height sensor_width"],
    valid_mask: Bool[Tensor, "sensor_height sensor_width"],
    *,
    depth_K: Float[Tensor, "3 3"],
    image_K: Float[Tensor, "3 3"],
    extrinsics: Float[Tensor, "4 4"],
    size: tuple[int, int],
) -> Registration:
    """Sees the measurements [m] of a depth camera with the image's: z changes, nothing is blended.

    depth_K, image_K: [px]. extrinsics: from the depth camera's frame to the image camera's, a
    rotation and a translation [m]. size: (height, width) of the image [px].

    Each measurement covers the rectangle that its pixel covers in the image, so that a finer image
    gets no holes; of those that cover a pixel the nearest is seen. One that lies behind the
    image's camera or outside its view is left out. Measurements that a nearer surface hides, and
    that still show between that surface's pixels, are left out too (see without_hidden).

    Raises InputError if `extrinsics` is no rigid motion.
    """
    _require_rigid(extrinsics)
    indices = valid_mask.flatten().nonzero().squeeze(1)
    motion = extrinsics.to(torch.float64)
    points = unproject(depth.double(), depth_K.double()).reshape(-1, 3)[indices]
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    in_front = moved[:, 2] > 0
    indices, moved = indices[in_front], moved[in_front]
    centre = project(moved, image_K.double())
    # half of what a sensor pixel covers in the image, at this point's distances
    spread = image_K.diagonal()[:2].double() / depth_K.diagonal()[:2].double()
    growth = (points[in_front][:, 2] / moved[:, 2]).clamp(max=_LARGEST_GROWTH)
    half = spread * growth[:, None] / 2
    values = moved[:, 2].to(depth.dtype)
    cells, owners = _covered_pixels(centre - half, centre + half, size)
    seen = nearest_of_each(depth, indices[owners], cells, values[owners], size)
    return without_hidden(seen)


def nearest_of_each(
    depth: Float[Tensor, "sensor_height sensor_width"],
    indices: Int64[Tensor, "hits"],
    cells: Int64[Tensor, "hits"],
    values: Float[Tensor, "hits"],
    size: tuple[int, int],
) -> Registration:
    """The smallest value in each pixel (cell) that is hit, and where in the sensor it is from."""
    height, width = size
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


def _covered_pixels(
    low: Float[Tensor, "points 2"], high: Float[Tensor, "points 2"], size: tuple[int, int]
) -> tuple[Int64[Tensor, "hits"], Int64[Tensor, "hits"]]:
    """Pixels whose centre lies in [low, high) (x, y), row-major, and the point that covers each.

    A rectangle that holds no centre covers the pixel that its middle lies in.
    """
    height, width = size
    limits = torch.tensor([width, height])
    middle = ((low + high) / 2).round()
    # rectangles side by side may miss each other by rounding, and a centre between them
    first, end = (low - _ROUNDING_PX).ceil(), high.ceil()
    empty = end <= first
    first, end = torch.where(empty, middle, first), torch.where(empty, middle + 1, end)
    first = first.clamp(min=-1.0).clamp(max=limits + 1.0).long()
    end = end.clamp(min=-1.0).clamp(max=limits + 1.0).long()
    most = (end - first).amax(0).tolist() if len(first) else [0, 0]
    cells, owners = [], []
    for y in range(most[1]):
        for x in range(most[0]):
            at = first + torch.tensor([x, y])
            inside = ((at < end) & (at >= 0) & (at < limits)).all(dim=1)
            owner = inside.nonzero().squeeze(1)
            cells.append(at[owner, 1] * width + at[owner, 0])
            owners.append(owner)
    none = torch.zeros(0, dtype=torch.int64)
    return torch.cat([none, *cells]), torch.cat([none, *owners])


def without_hidden(seen: Registration) -> Registration:
    """Drops pixels that nearer ones surround: a hidden surface that shows through a mesh.

    Hidden: in at least 5 of the 8 neighbours something is nearer by more than 5 %.
    """
    infinite = torch.full_like(seen.depth, torch.inf)
    padded = pad(torch.where(seen.valid_mask, seen.depth, infinite), (1, 1, 1, 1), value=torch.inf)
    height, width = seen.depth.shape
    nearer = torch.zeros_like(seen.source)
    for y, x in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
        nearer += padded[y : y + height, x : x + width] < seen.depth * (1 - _NEARER_BY)
    shown = seen.valid_mask & (nearer < _SURROUNDED)
    return Registration(
        depth=torch.where(shown, seen.depth, torch.zeros_like(seen.depth)),
        valid_mask=shown,
        source=torch.where(shown, seen.source, torch.zeros_like(seen.source)),
    )


def _require_rigid(extrinsics: Float[Tensor, "4 4"]) -> None:
    rotation, last = extrinsics[:3, :3].double(), extrinsics[3].double()
    is_rotation = torch.allclose(rotation @ rotation.T, torch.eye(3).double(), atol=1e-3)
    if not is_rotation or rotation.det() < 0 or last.tolist() != [0, 0, 0, 1]:
        raise InputError(
            "`extrinsics` must be a 4x4 rotation and translation [m] from the depth camera to the "
            "image's, with 0 0 0 1 as its last row"
        )


def _advice(size: tuple[int, int], sensor: tuple[int, int]) -> str:
    """Names both sizes, and the crop that would make them fit."""
    (height, width), (rows, columns) = size, sensor
    text = f"the image is {width}x{height} but the depth map {columns}x{rows}: another aspect ratio"
    fitting = (
        min(height, round(width * rows / columns)),
        min(width, round(height * columns / rows)),
    )
    lost = 1 - fitting[0] * fitting[1] / (height * width)
    if lost > _NEARLY:
        return (
            f"{text}, so not the same field of view; crop one to the other's, or register the "
            "depth by its camera with `depth_intrinsics` and `extrinsics`"
        )
    return (
        f"{text}; if the view is the same but for the border, crop the image to "
        f"{fitting[1]}x{fitting[0]} about its middle"
    )
