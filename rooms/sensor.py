"""Which pixels a depth camera with its own light, or a spinning LiDAR, would measure."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from rooms.render import RoomFrame

BASELINE_M = 0.075  # from the camera to the projector on its right
_WEAKEST_SIGNAL = 0.008  # albedo over square metres
_ROWS_A_LINE = 12  # 40 lines in 480 rows

Field = Float32[np.ndarray, "height width"]
Mask = Bool[np.ndarray, "height width"]


def sensor_holes(frame: RoomFrame, generator: np.random.Generator) -> Mask:
    """True where a sensor as in structured-light cameras would measure.

    Missing: what returns little light (dark, shiny, grazing, far), what is out of a range of
    4 to 5.5 m, glass, the projector's shadow on the left of near things, and some speckle.
    """
    height, width = frame.depth.shape
    patches = _smooth_noise(height, width, 24, generator)
    grains = _smooth_noise(height, width, 2, generator)
    signal = returned_light(frame) * np.exp(0.35 * patches + 0.25 * grains)
    reach = generator.uniform(4.0, 5.5) * np.exp(0.03 * patches + 0.01 * grains)
    in_range = (frame.depth > 0.4) & (frame.depth < reach)
    speckle = generator.random((height, width)) < 0.004
    through_glass = frame.glass & (grains < 2.5)  # a few false returns
    missing = ~in_range | (signal < _WEAKEST_SIGNAL) | projector_shadow(frame)
    return np.asarray(~(missing | through_glass | speckle))


def scan_lines(frame: RoomFrame, generator: np.random.Generator) -> Mask:
    """True on the rows that a spinning LiDAR's lines hit; glass and one in ten pixels are missing.

    Lines of equal elevation are taken as straight rows, which holds near the optical axis.
    """
    on_line = np.arange(frame.depth.shape[0]) % _ROWS_A_LINE == _ROWS_A_LINE // 2
    returned = generator.random(frame.depth.shape) < 0.9
    return np.asarray(on_line[:, None] & returned & ~frame.glass)


def returned_light(frame: RoomFrame) -> Field:
    """Diffuse return of a light beside the camera: albedo * cosine / depth**2 [1/m^2].

    What shines reflects away from the camera, so it returns less.
    """
    height, width = frame.depth.shape
    x = (np.arange(width) - frame.K[0, 2]) / frame.K[0, 0]
    y = (np.arange(height) - frame.K[1, 2]) / frame.K[1, 1]
    ray = np.stack([*np.meshgrid(x, y), np.ones((height, width))], axis=-1).astype(np.float32)
    length = np.linalg.norm(ray, axis=-1)
    cosine = np.abs((ray * frame.normals).sum(axis=-1)) / length
    diffuse = frame.albedo.mean(axis=-1) * (1 - 0.9 * frame.shininess)
    signal: Field = (diffuse * cosine / (frame.depth * length) ** 2).astype(np.float32)
    return signal


def projector_shadow(frame: RoomFrame) -> Mask:
    """True where something nearer hides the pixel from the projector on the camera's right.

    Pixel x lies on the projector's column x - f * baseline / depth. It is hidden if a pixel
    further right lies on a column further left.
    """
    columns = np.arange(frame.depth.shape[1]) - frame.K[0, 0] * BASELINE_M / frame.depth
    leftmost = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(leftmost < columns - 0.01)


def _smooth_noise(height: int, width: int, cell: int, generator: np.random.Generator) -> Field:
    """Noise of unit spread that changes over about `cell` pixels of a 320-pixel-wide frame."""
    cell = max(1, cell * width // 320)
    coarse = generator.standard_normal((height // cell + 2, width // cell + 2), dtype=np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(smooth / smooth.std(), dtype=np.float32)
