"""The paired frames of a recording, with what is known of the cameras."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.bags.cameras import (
    Camera,
    camera_of,
    frame_name,
)
from steered_marigold.io.bags.messages import (
    NANOSECONDS,
    Message,
    stamp_ns,
)
from steered_marigold.io.bags.pairing import PairCounts, StampPairer
from steered_marigold.io.bags.poses import CameraPoses
from steered_marigold.io.bags.reading import (
    Reader,
    Topic,
    first_message,
    messages,
    open_reader,
    ros_version,
    topics_of,
)
from steered_marigold.io.bags.recorded_frame import RecordedFrame
from steered_marigold.io.bags.topics import (
    base_topic,
    camera_info_of,
    find_depth,
    find_image,
    find_info,
    is_registered_name,
    realsense_stream,
)
from steered_marigold.io.bags.transforms import fixed_transform
from steered_marigold.io.files import AnyPath


class Recording:
    """An opened recording; `open_recording` makes one.

    topics: all there are. image_topic, depth_topic, info_topic, depth_info_topic: those in use;
    the last two are None where there is none. extrinsics: as in DecodedFrame. start_ns: stamp of
    the first depth.
    """

    def __init__(
        self,
        reader: Reader,
        *,
        image_topic: str | None,
        depth_topic: str | None,
        info_topic: str | None,
    ) -> None:
        self._reader = reader
        self.path = Path(str(reader.path))
        self.ros = ros_version(reader)
        self.topics: tuple[Topic, ...] = topics_of(reader)
        firsts: dict[str, Message | None] = {}

        def first(topic: str) -> Message | None:
            if topic not in firsts:
                firsts[topic] = first_message(reader, topic)
            return firsts[topic]

        try:
            self.depth_topic = find_depth(self.topics, first, depth_topic)
            self.image_topic = find_image(self.topics, first, image_topic)
            self.info_topic = find_info(self.topics, self.image_topic, self.depth_topic, info_topic)
        except FileFormatError:
            raise
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None
        self.depth_info_topic = camera_info_of(self.depth_topic, self.topics)
        self.depth_count = sum(
            topic.count for topic in self.topics if topic.name == self.depth_topic
        )
        self._cameras = {
            topic: self._camera(message)
            for topic in (self.info_topic, self.depth_info_topic)
            if topic and (message := first(topic))
        }
        first_image, first_depth = first(self.image_topic), first(self.depth_topic)
        if first_image is None or first_depth is None:
            raise FileFormatError(f"{self.path}: its index lists messages that are not there")
        self.start_ns = _stamp_of(first_depth)
        self._depth_scale = self._realsense_depth_scale()
        self._camera_frame = _frame_of(first_image)
        self.extrinsics = self._find_extrinsics(_frame_of(first_depth))

    def frames(
        self,
        *,
        slop: float = 0.02,
        every: int = 1,
        start: float = 0.0,
        duration: float | None = None,
        poses: CameraPoses | None = None,
    ) -> "FrameStream":
        """The paired frames; see FrameStream.

        Raises InputError for an argument out of range.
        """
        for name, value in (("slop", slop), ("start", start), ("duration", duration)):
            if value is not None and not (value >= 0 and isfinite(value)):
                raise InputError(f"`{name}` must be a number of seconds from 0 on, not {value}")
        if every < 1:
            raise InputError(f"`every` must be a whole number from 1 on, not {every}")
        return FrameStream(
            self, slop=slop, every=every, start=start, duration=duration, poses=poses
        )

    @contextmanager
    def camera_poses(self, fixed_frame: str | None = None) -> Iterator[CameraPoses]:
        """The image's camera at the times of frames, for `frames`; reads /tf beside them.

        fixed_frame: what stands still; None: see CameraPoses.
        """
        with open_reader(self.path) as reader:
            yield CameraPoses(reader, self._camera_frame, fixed_frame=fixed_frame)

    def _camera(self, message: Message) -> Camera | None:
        """The camera of a camera_info message; its image is rectified if its topic says so."""
        pictures = [
            topic
            for topic in (self.image_topic, self.depth_topic)
            if camera_info_of(topic, self.topics) == message.topic
        ]
        name = base_topic(pictures[0] if pictures else self.image_topic).rpartition("/")[2]
        return camera_of(message.decode(), rectified="rect" in name)

    def _realsense_depth_scale(self) -> float | None:
        """The unit [m] among the options that librealsense records; newer images hold it, too."""
        stream = realsense_stream(self.depth_topic)
        if stream is None:
            return None
        sensor = stream.rpartition("/")[0]
        names = [f"{sensor}/option/Depth{blank}Units/value" for blank in " _"]
        for message in messages(self._reader, names):
            return float(message.decode().data)
        return None

    def _find_extrinsics(self, depth_frame: str) -> Float[Tensor, "4 4"] | None:
        """Depth camera to image's; None if depth lies in the image's view.

        Raises InputError that says what is missing for registering depth.
        """
        camera = self._cameras.get(self.info_topic or "")
        depth_camera = self._cameras.get(self.depth_info_topic or "")
        frames = depth_frame, self._camera_frame
        if is_registered_name(self.depth_topic) or (
            frames[0] == frames[1] and _same_view(camera, depth_camera)
        ):
            return None
        matrix = fixed_transform(self._reader, *frames)
        missing = [
            what
            for what, known in (
                (f"the camera_info of {self.image_topic} (`info_topic`)", camera is not None),
                (f"the camera_info of {self.depth_topic}", depth_camera is not None),
                (f"a fixed transform from {frames[0]!r} to {frames[1]!r}", matrix is not None),
            )
            if not known
        ]
        if matrix is None or missing:
            raise InputError(
                f"{self.path}: depth ({self.depth_topic}, frame {frames[0]!r}) is not registered "
                f"to the image ({self.image_topic}, frame {frames[1]!r}), and for registering it "
                f"the recording lacks {', '.join(missing)}; record the driver's registered depth, "
                "or choose another `depth_topic`"
            )
        return torch.from_numpy(matrix.astype(np.float32))


class FrameStream:
    """Paired frames in the order of depth, read as they are asked for; iterate it once.

    slop: stamps of a pair differ by no more [s]; `StampPairer` says which are joined. A message
    without a stamp has its log time as one. every: takes each n-th pair. start, duration: [s] from
    the first depth on. poses: asked for the pose of each frame; None gives frames without.
    counts: what became of the messages read so far.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        slop: float,
        every: int,
        start: float,
        duration: float | None,
        poses: CameraPoses | None,
    ) -> None:
        self._recording, self._every, self._poses = recording, every, poses
        self._slop_ns = round(slop * NANOSECONDS)
        first_ns = recording.start_ns + round(start * NANOSECONDS)
        self._start_ns = first_ns if start else 0
        self._end_ns = 2**63 if duration is None else first_ns + round(duration * NANOSECONDS)
        self._pairer: StampPairer[tuple[Message, int, dict[str, Camera | None]]] = StampPairer(
            self._slop_ns
        )

    @property
    def counts(self) -> PairCounts:
        """How many were paired, and how many were not."""
        return self._pairer.counts

    def __iter__(self) -> Iterator[RecordedFrame]:
        pairs = self._pairs()
        for index, ((image, _, _), (depth, stamp, cameras)) in enumerate(pairs):
            if index % self._every == 0:
                recording, pose = self._recording, None
                if self._poses is not None:
                    pose = self._poses.at(stamp, depth.log_time_ns)
                yield RecordedFrame(
                    index=index,
                    stamp_ns=stamp,
                    image=image,
                    depth=depth,
                    camera=cameras.get(recording.info_topic or ""),
                    depth_camera=cameras.get(recording.depth_info_topic or ""),
                    extrinsics=recording.extrinsics,
                    pose=None if pose is None else torch.from_numpy(pose),
                    depth_scale=recording._depth_scale,
                )

    def _pairs(self) -> Iterator[Any]:
        recording = self._recording
        cameras = dict(recording._cameras)
        topics = {recording.image_topic, recording.depth_topic, *cameras}
        beyond: set[str] = set()
        for message in messages(recording._reader, topics):
            if message.topic in cameras:
                cameras = {**cameras, message.topic: recording._camera(message)}
                continue
            stamp, is_depth = _stamp_of(message), message.topic == recording.depth_topic
            margin = 0 if is_depth else self._slop_ns
            if stamp >= self._end_ns + margin:
                beyond.add(message.topic)
                if len(beyond) == 2:
                    break
            elif stamp >= self._start_ns - margin:
                add = self._pairer.add_depth if is_depth else self._pairer.add_image
                yield from add(stamp, (message, stamp, cameras))
        yield from self._pairer.finish()


@contextmanager
def open_recording(
    path: AnyPath,
    *,
    image_topic: str | None = None,
    depth_topic: str | None = None,
    info_topic: str | None = None,
) -> Iterator[Recording]:
    """Opens a ROS 1 .bag (also of a RealSense camera), a ROS 2 bag's folder, a .mcap or a .db3.

    Topics that are not named are found if there is one candidate of each: depth that the driver
    registered wins over depth as it was measured, colour over grey, and an image's camera_info is
    its neighbour.

    Raises FileFormatError if it is missing, damaged or no recording. InputError where topics must
    be named, listing the candidates, and where depth is not registered to the image and the
    recording lacks what that takes.
    """
    with open_reader(path) as reader:
        yield Recording(
            reader, image_topic=image_topic, depth_topic=depth_topic, info_topic=info_topic
        )


def _stamp_of(message: Message) -> int:
    """[ns] of the header, or of the log where the header has none."""
    return stamp_ns(message.decode().header) or message.log_time_ns


def _frame_of(message: Message) -> str:
    """The frame that a picture was taken in; librealsense's have the name of their stream."""
    return realsense_stream(message.topic) or frame_name(message.decode().header.frame_id)


def _same_view(camera: Camera | None, depth_camera: Camera | None) -> bool:
    """Whether both see the same, as far as is known: equal K in images of equal size."""
    if camera is None or depth_camera is None:
        return True
    return torch.allclose(camera.K, depth_camera.K_at(camera.size), rtol=1e-3, atol=0.5)
