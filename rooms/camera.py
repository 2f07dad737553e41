"""Pinhole cameras in a room. Camera frame: x right, y down, z forward. World: z up."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

FRAMES_PER_SECOND = 30


@dataclass(frozen=True)
class Camera:
    """K: intrinsics [px], principal point in the image's centre. rotation: camera axes as columns
    in the world. position: [m].
    """

    K: Float[np.ndarray, "3 3"]
    rotation: Float[np.ndarray, "3 3"]
    position: Float[np.ndarray, "3"]

    def rays(
        self, width: int, height: int
    ) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]:
        """Origins and world directions through the pixel centres, row by row.

        A direction has length 1 along the optical axis, so distances along it are z-depths.
        """
        v, u = np.divmod(np.arange(width * height), width)
        x = (u - self.K[0, 2]) / self.K[0, 0]
        y = (v - self.K[1, 2]) / self.K[1, 1]
        directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ self.rotation.T
        origins = np.tile(self.position, (len(directions), 1))
        return origins.astype(np.float32), directions.astype(np.float32)

    def resized(self, width: int) -> "Camera":
        """The same view `width` pixels wide."""
        factor = width / (2 * self.K[0, 2] + 1)
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


def hand_held(camera: Camera, frames: int, generator: np.random.Generator) -> Iterator[Camera]:
    """The camera as it sways about where it is, in a circle of 0.3 m and about 15 degrees."""
    reach = np.array([0.15, 0.15, 0.08, *np.radians([5, 8, 2])])  # metres; pitch, yaw, roll
    period = generator.uniform(2.5, 6.0, 6)  # [s]
    phase = generator.uniform(0, 2 * np.pi, 6)
    for i in range(frames):
        turns = 2 * np.pi * i / FRAMES_PER_SECOND / period
        move = reach * (np.sin(turns + phase) - np.sin(phase))
        # small rotations about the camera's own axes x (pitch), y (yaw), z (roll)
        rotation = camera.rotation @ _rotation(move[3:])
        yield Camera(camera.K, rotation, camera.position + move[:3])


def _rotation(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation about `vector` by its length [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Float[np.ndarray, "3 3"] = (
        np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    )
    return rotation
