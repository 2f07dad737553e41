"""Frames of recordings; what the sensor measured stands for the truth."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from steered_marigold.core.doubts import scale_doubts
from steered_marigold.core.frame import Frame
from steered_marigold.core.registration import register_depth, register_depth_camera
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError
from steered_marigold.io.bags import RecordedFrame, open_recording

_NANOSECOND = 1e-9


@dataclass(frozen=True)
class RecordingFrames:
    """The paired frames of a ROS or RealSense recording (see `open_recording`).

    Frame ids are the stamps of depth [ns]. Sensors leave holes, so use it with protocols that hide
    a part of what was measured, such as "region".

    Raises FileFormatError if it is no recording or holds no pair, InputError if its topics must be
    named, MissingExtraError without rosbags.
    """

    path: Path
    name: ClassVar[str] = "recording"

    def __post_init__(self) -> None:
        if not self.frame_ids:
            raise FileFormatError(f"{self.path}: holds no image and depth within 20 ms")

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        with open_recording(self.path) as recording:
            return tuple(sorted(str(frame.stamp_ns) for frame in recording.frames()))

    def load(self, frame_id: str) -> Sample:
        with open_recording(self.path) as recording:
            since_first = (int(frame_id) - recording.start_ns) * _NANOSECOND
            # a little earlier and longer: seconds are not nanoseconds
            near = recording.frames(start=max(since_first - 0.1, 0.0), duration=0.2)
            found = next(frame for frame in near if str(frame.stamp_ns) == frame_id)
            frame = recorded_frame(found)
        return Sample(frame=frame, metric_depth=frame.sparse_depth, metric_mask=frame.valid_mask)


def recorded_frame(recorded: RecordedFrame) -> Frame:
    """A frame of a recording, decoded; its id is its stamp in nanoseconds.

    Raises FileFormatError if a message is damaged, InputError if depth does not fit the image.
    """
    decoded = recorded.decode()
    height, width = decoded.image.shape[:2]
    depth, valid_mask = decoded.depth, decoded.valid_mask
    if decoded.extrinsics is not None and decoded.K is not None and decoded.depth_K is not None:
        moved = register_depth_camera(
            depth,
            valid_mask,
            depth_K=decoded.depth_K,
            image_K=decoded.K,
            extrinsics=decoded.extrinsics,
            size=(height, width),
        )
        depth, valid_mask = moved.depth, moved.valid_mask
    elif depth.shape != (height, width):
        moved = register_depth(depth, valid_mask, (height, width))
        depth, valid_mask = moved.depth, moved.valid_mask
    frame = Frame(
        image=decoded.image,
        sparse_depth=depth,
        valid_mask=valid_mask,
        K=decoded.K,
        pose=recorded.pose,
        id=str(recorded.stamp_ns),
        stamp=recorded.stamp_s,
    ).plausible()
    doubts = scale_doubts(frame.sparse_depth, frame.valid_mask)
    return replace(frame, notices=frame.notices + doubts)
