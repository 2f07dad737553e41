"""How cameras see: camera_info."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.geometry import resize_intrinsics


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera.

    K: [px]; of a rectified image it is the one of the rectification.
    size: (height, width) [px] that K belongs to, (0, 0) if the recording does not say.
    distortion: coefficients of distortion_model, which K leaves out; all 0 if rectified.
    """

    K: Float[Tensor, "3 3"]
    size: tuple[int, int]
    distortion_model: str
    distortion: tuple[float, ...]
    frame_id: str

    def K_at(self, size: tuple[int, int]) -> Float[Tensor, "3 3"]:  # noqa: N802
        """K of the same view in an image of another size (height, width)."""
        if 0 in self.size or size == self.size:
            return self.K
        return resize_intrinsics(self.K, size=self.size, new_size=size)


def camera_of(message: Any, *, rectified: bool) -> Camera | None:
    """The camera of a camera_info message; None where it is not calibrated (K is 0).

    rectified: the image is; P then says how it sees, and K how it did before (REP 104).
    """
    # ROS 1 spells the fields D, K, P, ROS 2 d, k, p
    D, K, P = (getattr(message, name if hasattr(message, name) else name.lower()) for name in "DKP")
    matrix = np.asarray(K, np.float64).reshape(3, 3)
    distortion = tuple(float(value) for value in D)
    projection = np.asarray(P, np.float64).reshape(3, 4)[:, :3]
    if rectified and projection[0, 0] > 0:
        matrix, distortion = projection, (0.0,) * len(distortion)
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        return None
    return Camera(
        K=torch.from_numpy(matrix.astype(np.float32)),
        size=(int(message.height), int(message.width)),
        distortion_model=message.distortion_model,
        distortion=distortion,
        frame_id=frame_name(message.header.frame_id),
    )


def frame_name(frame_id: str) -> str:
    """A frame's name; old ROS 1 programs put a slash before it."""
    return frame_id.lstrip("/")
