"""IP-Basic: completion by dilation, closing and blur."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from steered_marigold.errors import InputError, NoMeasurementsError
from steered_marigold.methods.classical import ClassicalCompleter

_STEPS = np.abs(np.arange(-2, 3))
DIAMOND_5 = (np.add.outer(_STEPS, _STEPS) <= 2).astype(np.uint8)


class IpBasicCompleter(ClassicalCompleter):
    """Ku, Harakeh and Waslander, "In Defense of Classical Image Processing: Fast Depth Completion
    on the CPU", CRV 2018 (arXiv 1802.00036): the version of the paper's result, with extension to
    the top of the image and Gaussian blur.

    Two things differ. Holes that the 31x31 dilation leaves open (a large erased area, columns with
    no measurement at the image's side) are filled by repeating it. And what is empty is known from
    valid_mask: the published code takes depths below 0.1 m for empty.

    The filters also move measured pixels; nearer depths win over farther ones.

    max_depth [m]: measurements from here on count as missing. Its value changes nothing else.
    The default is the published one, made for KITTI; for indoor sensors 20 is safe.
    """

    name = "ip-basic"

    def __init__(self, *, max_depth: float = 100.0) -> None:
        if not 0 < max_depth <= 1000:
            raise InputError(f"max_depth is {max_depth}; it must lie above 0 and up to 1000 m")
        self.max_depth = max_depth

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        near = valid_mask & (sparse_depth < self.max_depth)
        if not near.any():
            raise NoMeasurementsError(
                f"{self.name}: no measurement is nearer than max_depth = {self.max_depth} m"
            )
        # nearness, so that dilation, a maximum, prefers the foreground; 0 is empty
        measured = np.where(near, self.max_depth - sparse_depth, 0).astype(np.float32)
        dilated = cv2.dilate(measured, DIAMOND_5)
        closed = cv2.morphologyEx(dilated, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        nearness = _extend_to_top(_fill_empty(closed, side=7))
        while not nearness.all():
            nearness = _fill_empty(nearness, side=31)
        smooth = cv2.GaussianBlur(cv2.medianBlur(nearness, 5), (5, 5), 0)
        return np.asarray(self.max_depth - smooth, np.float32)


def _fill_empty(
    nearness: Float[np.ndarray, "height width"], *, side: int
) -> Float[np.ndarray, "height width"]:
    """The largest value within a square of `side` pixels, at the empty pixels only."""
    dilated = cv2.dilate(nearness, np.ones((side, side), np.uint8))
    return np.where(nearness > 0, nearness, dilated)


def _extend_to_top(
    nearness: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """Each column's topmost value, repeated up to the border of the image."""
    top = np.argmax(nearness > 0, axis=0)
    above = np.arange(len(nearness))[:, None] < top
    return np.where(above, nearness[top, np.arange(nearness.shape[1])], nearness)
