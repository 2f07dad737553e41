"""How a camera moved between two frames, estimated by OpenCV."""

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from steered_marigold.errors import InputError


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
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(
        before, now, np.zeros((*now.shape, 2), np.float32)
    )
    return torch.from_numpy(np.ascontiguousarray(flow))
