"""One frame of a recording: the messages, and what they hold."""

from dataclasses import dataclass

from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.io.bags.cameras import Camera
from steered_marigold.io.bags.image_messages import decode_depth, decode_image
from steered_marigold.io.bags.messages import NANOSECONDS, Message


@dataclass(frozen=True, kw_only=True)
class DecodedFrame:
    """What a frame holds as tensors.

    depth: [m], 0 where valid_mask is False. K, depth_K: [px], of an image and a depth map of these
    sizes; None where the recording does not tell. extrinsics: 4x4, points of the depth camera [m]
    to points of the image's; None if depth lies in the image's view.
    """

    image: UInt8[Tensor, "height width 3"]
    depth: Float[Tensor, "depth_height depth_width"]
    valid_mask: Bool[Tensor, "depth_height depth_width"]
    K: Float[Tensor, "3 3"] | None
    depth_K: Float[Tensor, "3 3"] | None  # noqa: N815
    extrinsics: Float[Tensor, "4 4"] | None


@dataclass(frozen=True, kw_only=True)
class RecordedFrame:
    """An image and the depth that was measured with it, not decoded yet.

    index: of the pair in the recording, from 0. stamp_ns: when depth was measured.
    camera, depth_camera: None where the recording does not tell; extrinsics as in DecodedFrame.
    pose: 4x4, the image's camera to a frame that stands still [m], if it is asked for and known.
    depth_scale: metres a step of 16-bit depth, None as `decode_depth` has it.
    """

    index: int
    stamp_ns: int
    image: Message
    depth: Message
    camera: Camera | None
    depth_camera: Camera | None
    extrinsics: Float[Tensor, "4 4"] | None
    pose: Float[Tensor, "4 4"] | None
    depth_scale: float | None

    @property
    def stamp_s(self) -> float:
        """When depth was measured [s]."""
        return self.stamp_ns / NANOSECONDS

    def decode(self) -> DecodedFrame:
        """The tensors; FileFormatError if a message is damaged or of an unknown encoding."""
        image = decode_image(self.image.decode(), str(self.image))
        measured = decode_depth(self.depth.decode(), str(self.depth), depth_scale=self.depth_scale)
        height, width = image.shape[:2]
        rows, columns = measured.depth.shape
        return DecodedFrame(
            image=image,
            depth=measured.depth,
            valid_mask=measured.valid_mask,
            K=self.camera.K_at((height, width)) if self.camera else None,
            depth_K=self.depth_camera.K_at((rows, columns)) if self.depth_camera else None,
            extrinsics=self.extrinsics,
        )
