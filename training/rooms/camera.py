"""Pinhole cameras in a room. Camera frame: x right, y down, z forward."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32


@dataclass(frozen=True)
class Camera:
    """K: intrinsics [px]. rotation: camera axes as columns in the world. position: [m]."""

    K: Float[np.ndarray, "3 3"]
    rotation: Float[np.ndarray, "3 3"]
    position: Float[np.ndarray, "3"]

    def rays(self, width: int, height: int) -> Float32[np.ndarray, "height width 3"]:
        """World directions through the pixel centres, scaled so that z-depth is 1 per unit."""
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        x = (u - self.K[0, 2]) / self.K[0, 0]
        y = (v - self.K[1, 2]) / self.K[1, 1]
        local = np.stack([x, y, np.ones_like(x)], axis=-1)
        rays: Float32[np.ndarray, "height width 3"] = (local @ self.rotation.T).astype(np.float32)
        return rays

    def resized(self, factor: float) -> "Camera":
        """The same view with `factor` times as many pixels along each side."""
        K = self.K.copy()
        K[:2] *= factor
        K[:2, 2] += (factor - 1) / 2  # pixel centres are at integers
        return Camera(K, self.rotation, self.position)


def intrinsics(width: int, height: int, view_angle: float) -> Float[np.ndarray, "3 3"]:
    """K [px] for a horizontal field of view [rad], principal point in the centre."""
    f = width / 2 / np.tan(view_angle / 2)
    return np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])


def look(yaw: float, pitch: float, roll: float) -> Float[np.ndarray, "3 3"]:
    """Rotation of a camera that looks along `yaw` (about z up), `pitch` up, then rolls [rad]."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    forward = np.array([cp * cy, cp * sy, sp])
    right = np.array([sy, -cy, 0.0])
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
