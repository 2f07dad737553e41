"""The pinhole camera: pixels to points and back, and what crops and resizes do to K.

Camera frame: x right, y down, z forward [m]. Pixel centres lie at integer coordinates, so the image
spans [-0.5, width - 0.5] x [-0.5, height - 0.5]. Sizes are (height, width), as tensors have them.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import SizeMismatchError


def unproject(
    depth: Float[Tensor, "*batch height width"], K: Float[Tensor, "3 3"]
) -> Float[Tensor, "*batch height width 3"]:
    """Points in the camera frame [m] of every pixel; depth [m] is z along the optical axis."""
    K = K.to(depth)
    height, width = depth.shape[-2:]
    v = torch.arange(height, dtype=depth.dtype, device=depth.device)[:, None]
    u = torch.arange(width, dtype=depth.dtype, device=depth.device)[None, :]
    y = (v - K[1, 2]) / K[1, 1]
    x = (u - K[0, 2] - K[0, 1] * y) / K[0, 0]
    return torch.stack((x * depth, y * depth, depth), dim=-1)


def project(
    points: Float[Tensor, "*batch 3"], K: Float[Tensor, "3 3"]
) -> Float[Tensor, "*batch 2"]:
    """Pixel coordinates (x, y) [px] of points [m]; meaningful only where z > 0."""
    homogeneous = points @ K.to(points).T
    return homogeneous[..., :2] / homogeneous[..., 2:]


def ray_lengths(K: Float[Tensor, "3 3"], size: tuple[int, int]) -> Float[Tensor, "height width"]:
    """Length of each pixel's line of sight where z is 1; size: (height, width) [px].

    A sensor that measures along the ray gives z times this.
    """
    points = unproject(torch.ones(size, dtype=K.dtype, device=K.device), K)
    return points.square().sum(dim=-1).sqrt()


def rotation_of(quaternion: Float[Tensor, "4"]) -> Float[Tensor, "3 3"]:
    """The rotation of a quaternion x, y, z, w of length 1, in float64."""
    x, y, z, w = quaternion.tolist()
    return torch.tensor(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ],
        dtype=torch.float64,
    )


def crop_intrinsics(K: Float[Tensor, "3 3"], *, top: int, left: int) -> Float[Tensor, "3 3"]:
    """K of an image whose first `top` rows and `left` columns were cut off."""
    cropped = K.clone()
    cropped[0, 2] -= left
    cropped[1, 2] -= top
    return cropped


def resize_intrinsics(
    K: Float[Tensor, "3 3"], *, size: tuple[int, int], new_size: tuple[int, int]
) -> Float[Tensor, "3 3"]:
    """K of an image resized from `size` to `new_size` (height, width) [px].

    The borders of the image stay where they are (OpenCV, PIL, torch with align_corners=False), so
    a pixel at x moves to (x + 0.5) * new_width / width - 0.5.
    """
    scale_y, scale_x = new_size[0] / size[0], new_size[1] / size[1]
    resize = torch.eye(3, dtype=K.dtype, device=K.device)
    resize[0, 0], resize[0, 2] = scale_x, (scale_x - 1) / 2
    resize[1, 1], resize[1, 2] = scale_y, (scale_y - 1) / 2
    return resize @ K


def center_crop(size: tuple[int, int], crop_size: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of the centred window of `crop_size` in an image of `size` (height, width).

    Where a margin is odd, the smaller half is at the top or left.

    Raises SizeMismatchError if the window does not fit.
    """
    (height, width), (crop_height, crop_width) = size, crop_size
    if crop_height > height or crop_width > width:
        raise SizeMismatchError(
            f"the centre crop of {crop_width}x{crop_height} px does not fit an image of "
            f"{width}x{height} px; use a larger image"
        )
    top, left = (height - crop_height) // 2, (width - crop_width) // 2
    return slice(top, top + crop_height), slice(left, left + crop_width)
