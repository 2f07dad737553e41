"""Where cameras stand and how they see: camera_info and fixed transforms."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.geometry import resize_intrinsics

# transforms that differ less than this [m, rad] are one that was sent again
_STILL = 1e-6


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


def matrix_of(transform: Any) -> NDArray[Any]:
    """4x4 of a geometry_msgs Transform: points of the child to points of the parent."""
    t, q = transform.translation, transform.rotation
    quaternion = np.array([q.x, q.y, q.z, q.w])
    x, y, z, w = quaternion / (np.linalg.norm(quaternion) or 1)  # some drivers write only zeros
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = t.x, t.y, t.z
    return matrix


class StaticTransforms:
    """A forest of frames; those that move are not in it."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, NDArray[Any]]] = {}
        self._moving: set[str] = set()

    def add(self, parent: str, child: str, matrix: NDArray[Any]) -> None:
        """Notes that `matrix` takes points of `child` to points of `parent`."""
        parent, child = frame_name(parent), frame_name(child)
        known = self._parents.setdefault(child, (parent, matrix))
        if known[0] != parent or np.abs(known[1] - matrix).max() > _STILL:
            self._moving.add(child)

    def add_message(self, message: Any) -> None:
        """Notes all transforms of a TFMessage."""
        for stamped in message.transforms:
            matrix = matrix_of(stamped.transform)
            self.add(stamped.header.frame_id, stamped.child_frame_id, matrix)

    def lookup(self, source: str, target: str) -> NDArray[Any] | None:
        """4x4 from points of `source` to points of `target`; None if no fixed chain joins them."""
        upwards, downwards = (
            self._ancestors(frame_name(source)),
            self._ancestors(frame_name(target)),
        )
        for frame, to_frame in upwards.items():
            if frame in downwards:
                matrix: NDArray[Any] = np.linalg.inv(downwards[frame]) @ to_frame
                return matrix
        return None

    def _ancestors(self, frame: str) -> dict[str, NDArray[Any]]:
        """The frame and all above it, each with the matrix that takes its points there."""
        matrix = np.eye(4)
        found = {frame: matrix}
        while frame in self._parents and frame not in self._moving:
            frame, step = self._parents[frame]
            if frame in found:
                break
            matrix = step @ matrix
            found[frame] = matrix
        return found
