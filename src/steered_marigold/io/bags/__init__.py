"""Recordings of ROS 1, ROS 2 and RealSense cameras: read, paired, copied with depth added.

    with open_recording("kitchen.bag") as recording:
        extra = (
            message
            for frame in recording.frames()
            for message in completed_messages(frame, complete(frame.decode())).messages
        )
        copy_with(recording, "kitchen_completed.bag", extra)

Importing this package without rosbags raises MissingExtraError.
"""

from steered_marigold.errors import MissingExtraError

try:
    import rosbags  # noqa: F401
except ImportError as error:
    raise MissingExtraError("ros", "rosbags") from error

from steered_marigold.io.bags.cameras import Camera
from steered_marigold.io.bags.copying import (
    CompletedMessages,
    CopyRecord,
    ExtraMessage,
    completed_messages,
    completed_topics,
    copy_with,
)
from steered_marigold.io.bags.messages import Message
from steered_marigold.io.bags.pairing import PairCounts
from steered_marigold.io.bags.poses import CameraPoses
from steered_marigold.io.bags.reading import BAG_SUFFIXES, Topic, list_topics
from steered_marigold.io.bags.recorded_frame import DecodedFrame, RecordedFrame
from steered_marigold.io.bags.recording import FrameStream, Recording, open_recording

__all__ = [
    "BAG_SUFFIXES",
    "Camera",
    "CameraPoses",
    "CompletedMessages",
    "CopyRecord",
    "DecodedFrame",
    "ExtraMessage",
    "FrameStream",
    "Message",
    "PairCounts",
    "RecordedFrame",
    "Recording",
    "Topic",
    "completed_messages",
    "completed_topics",
    "copy_with",
    "list_topics",
    "open_recording",
]
