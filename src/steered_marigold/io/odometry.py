"""How a camera moved between two frames, estimated by OpenCV."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from steered_marigold.core.frame import Frame
from steered_marigold.core.memory import Warp
from steered_marigold.core.warping import warp_by_flow, warp_depth
from steered_marigold.errors import InputError

# share of both frames' pixels that must have depth for odometry to be better than flow
_LEAST_SHARE = 0.2
# side [px] of the smallest image that OpenCV's search takes in any case
LEAST_SIDE_OF_FLOW = 12


MotionSource = Literal["pose", "odometry", "flow"]


@dataclass(frozen=True)
class FoundWarp:
    """A warp, and what told the motion."""

    warp: Warp
    source: MotionSource


def find_warp(
    earlier: Frame, present: Frame, *, motion: Float[Tensor, "4 4"] | None = None
) -> FoundWarp | None:
    """How the present frame sees what the earlier one held; None if their sizes differ, or both
    are too small for flow where nothing else tells the motion.

    motion: points of the earlier camera frame [m] to the present one, where poses tell. Else it
    is estimated by odometry, if K is known and both frames have depth in a fifth of their pixels;
    else pixels follow the flow of the image.
    """
    if earlier.size != present.size:
        return None
    source: MotionSource = "pose"
    if motion is None and present.K is not None and _has_odometry(earlier, present):
        source = "odometry"
        motion = RgbdOdometry(present.K).motion(
            earlier.image, earlier.sparse_depth, present.image, present.sparse_depth
        )
    if motion is not None and present.K is not None:
        K, known = present.K, motion
        return FoundWarp(lambda depth, mask: warp_depth(depth, mask, K, known), source)
    if min(present.size) < LEAST_SIDE_OF_FLOW:
        return None
    flow = image_flow(earlier.image, present.image)
    return FoundWarp(lambda depth, mask: warp_by_flow(depth, mask, flow), "flow")


def _has_odometry(earlier: Frame, present: Frame) -> bool:
    shares = (float(frame.valid_mask.float().mean()) for frame in (earlier, present))
    return hasattr(cv2, "Odometry") and min(shares) >= _LEAST_SHARE


class RgbdOdometry:
    """The motion between frames that have depth, from their colours and surfaces together.

    OpenCV's RGB-D odometry: Steinbruecker, Sturm and Cremers, "Real-time visual odometry from
    dense RGB-D images", 2011, and point-to-plane ICP.
    """

    def __init__(self, K: Float[Tensor, "3 3"]) -> None:
        """K: [px]. Raises InputError if this OpenCV has no odometry."""
        if not hasattr(cv2, "Odometry"):
            raise InputError(
                f"OpenCV {cv2.__version__} has no odometry; version 5 has: pip install --upgrade "
                "opencv-python-headless, or give the camera's motion"
            )
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(K.double().numpy().astype(np.float32))
        self._odometry = cv2.Odometry(
            cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON
        )

    def motion(
        self,
        earlier_image: UInt8[Tensor, "height width 3"],
        earlier_depth: Float[Tensor, "height width"],
        image: UInt8[Tensor, "height width 3"],
        depth: Float[Tensor, "height width"],
    ) -> Float[Tensor, "4 4"] | None:
        """Points of the earlier camera frame [m] to the present one; None if it is not found.

        Depth [m], 0 = unknown: measurements, or an answer where too little was measured.
        """
        earlier, present = (
            cv2.OdometryFrame(depth=metres.float().numpy().copy(), image=colours.numpy().copy())
            for colours, metres in ((earlier_image, earlier_depth), (image, depth))
        )
        try:
            self._odometry.prepareFrames(earlier, present)
            found, matrix = self._odometry.compute(earlier, present)
        except cv2.error:  # too few pixels with depth
            return None
        if not found or not np.isfinite(matrix).all():
            return None
        return torch.from_numpy(np.asarray(matrix, np.float32))


def image_flow(
    earlier_image: UInt8[Tensor, "height width 3"], image: UInt8[Tensor, "height width 3"]
) -> Float[Tensor, "height width 2"]:
    """Where each pixel of the earlier image went, (x, y) [px].

    Dense inverse search: Kroeger, Timofte, Dai and Van Gool, "Fast optical flow using dense
    inverse search", ECCV 2016.
    """
    before, now = (
        cv2.cvtColor(each.numpy(), cv2.COLOR_RGB2GRAY) for each in (earlier_image, image)
    )
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    flow = search.calc(before, now, np.zeros((*before.shape, 2), np.float32))
    return torch.from_numpy(np.asarray(flow))
