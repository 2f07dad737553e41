"""The sample frame of the package: one rendered room as a depth camera would deliver it."""


import cv2
import numpy as np

from training.rooms.render import RoomFrame, render_room
from training.rooms.sensor import sensor_holes

SEED = 0
WIDTH, HEIGHT = 640, 480


def sample_frame(seed: int = SEED) -> tuple[RoomFrame, np.ndarray, np.ndarray]:
    """The frame, its anti-aliased picture and the sensor's validity mask."""
    frame = render_room(seed, width=WIDTH, height=HEIGHT)
    large = render_room(seed, width=2 * WIDTH, height=2 * HEIGHT).image
    picture = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return frame, picture, sensor_holes(frame, np.random.default_rng(seed))
