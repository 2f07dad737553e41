"""Straight lines again: images and depth maps without the distortion of their lens (OpenCV)."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.errors import InputError

_COUNTS = (4, 5, 8, 12, 14)


def undistort_image(
    image: UInt8[Tensor, "height width 3"],
    K: Float[Tensor, "3 3"],
    distortion: Sequence[float],
) -> UInt8[Tensor, "height width 3"]:
    """The image [0, 255] that a camera with this K [px] and no distortion would have taken.

    distortion: OpenCV's k1, k2, p1, p2 and, if given, k3 and so on. What lies outside the image is
    black. Raises InputError for another number of coefficients.
    """
    maps = _maps(K, distortion, (image.shape[0], image.shape[1]))
    moved = cv2.remap(image.cpu().numpy(), *maps, interpolation=cv2.INTER_LINEAR)
    return torch.from_numpy(moved)


def undistort_depth(
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    K: Float[Tensor, "3 3"],
    distortion: Sequence[float],
) -> tuple[Float[Tensor, "height width"], Bool[Tensor, "height width"]]:
    """Depth [m] and its mask, as undistort_image; each pixel takes the nearest, none is blended.

    Other maps of the sensor, such as its confidence, can be given as `depth`.
    """
    maps = _maps(K, distortion, (depth.shape[0], depth.shape[1]))
    values, known = (
        torch.from_numpy(cv2.remap(array.cpu().numpy(), *maps, interpolation=cv2.INTER_NEAREST))
        for array in (depth.float(), valid_mask.to(torch.uint8))
    )
    valid = known > 0
    return torch.where(valid, values, torch.zeros_like(values)), valid


def _maps(
    K: Float[Tensor, "3 3"], distortion: Sequence[float], size: tuple[int, int]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """For each undistorted pixel the place (x, y) [px] in the file's."""
    if len(distortion) not in _COUNTS:
        raise InputError(
            f"`distortion` has {len(distortion)} coefficients; OpenCV's are k1, k2, p1, p2, then "
            "k3, or 8, 12 or 14 of them"
        )
    matrix = K.cpu().double().numpy()
    coefficients = np.array(distortion, np.float64)
    x, y = cv2.initUndistortRectifyMap(matrix, coefficients, None, matrix, size[::-1], cv2.CV_32FC1)
    return x, y
