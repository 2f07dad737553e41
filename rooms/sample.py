"""The sample frame of the package: one rendered room as a depth camera would deliver it."""

import tempfile
from pathlib import Path

import cv2
import numpy as np

from rooms.render import render_room
from rooms.sensor import sensor_holes

SEED = 295  # chosen by eye
WIDTH, HEIGHT = 640, 480


def write_sample(folder: Path, seed: int = SEED) -> None:
    """Writes image.jpg, depth.png (uint16 millimetres, 0 = missing) and intrinsics.txt (K [px]).

    The picture is rendered at twice the size and averaged; depth is not, so its edges are sharp.
    """
    frame = render_room(seed, width=WIDTH, height=HEIGHT)
    large = render_room(seed, width=2 * WIDTH, height=2 * HEIGHT).image
    image = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    valid = sensor_holes(frame, np.random.default_rng(seed))
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
