"""The sample frames of the package: rendered rooms as depth sensors would deliver them."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from rooms.render import RoomFrame, render_room
from rooms.sensor import Mask, scan_lines, sensor_holes


class Scene(NamedTuple):
    """A room, chosen by eye, and what a sensor measures of it."""

    seed: int
    measure: Callable[[RoomFrame, np.random.Generator], Mask]


SCENES = {
    "room": Scene(295, sensor_holes),
    "office": Scene(310, sensor_holes),
    "chair": Scene(318, scan_lines),
}
WIDTH, HEIGHT = 640, 480


def write_sample(folder: Path, scene: str = "room") -> None:
    """Writes image.jpg, depth.png (uint16 millimetres, 0 = missing) and intrinsics.txt (K [px]).

    The picture is rendered at twice the size and averaged; depth is not, so its edges are sharp.
    """
    seed, measure = SCENES[scene]
    frame = render_room(seed, width=WIDTH, height=HEIGHT)
    large = render_room(seed, width=2 * WIDTH, height=2 * HEIGHT).image
    image = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    valid = measure(frame, np.random.default_rng(seed))
    depth = np.where(valid, np.round(frame.depth * 1000), 0).astype(np.uint16)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        files = [Path(temporary) / name for name in ("image.jpg", "depth.png", "intrinsics.txt")]
        picture = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(files[0]), picture, [cv2.IMWRITE_JPEG_QUALITY, 92])
        cv2.imwrite(str(files[1]), depth, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        np.savetxt(files[2], frame.K, fmt="%.6f")
        for file in files:
            file.replace(folder / file.name)
