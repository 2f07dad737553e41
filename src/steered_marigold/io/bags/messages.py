"""ROS messages as bytes and as objects.

The messages that matter here have had one layout in all distributions, so that the types that
rosbags ships can read any recording, also one that holds no definitions.
"""

import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from steered_marigold.errors import FileFormatError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORM = "geometry_msgs/msg/Transform"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

RosVersion = Literal[1, 2]
NANOSECONDS = 10**9
_UNIT = struct.Struct("<f")


@lru_cache(maxsize=2)
def typestore(ros: RosVersion) -> Any:
    """The types of one version of ROS, a `rosbags.typesys.store.Typestore`."""
    if ros == 2:
        return get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS[0]))
    return store


@dataclass(frozen=True, kw_only=True)
class Message:
    """One message as it was recorded.

    log_time_ns: when it was written down; its header, if it has one, says when it was measured.
    data: serialised as its version of ROS does.
    where: names the recording in errors.
    """

    topic: str
    type: str
    log_time_ns: int
    data: bytes
    ros: RosVersion
    where: str

    def decode(self) -> Any:
        """The object with the message's fields; FileFormatError if the bytes are damaged.

        An image of a RealSense recording gets one field more, `depth_units` [m].
        """
        try:
            if self.ros == 2:
                return typestore(2).deserialize_cdr(self.data, self.type)
            return _decode_ros1(self.data, self.type)
        except Exception as error:  # rosbags raises many kinds for damaged bytes
            raise FileFormatError(f"{self}: damaged, or not of its kind ({error})") from error

    def __str__(self) -> str:
        """How errors name the message."""
        return f"{self.where}: {self.topic} at {self.log_time_ns / NANOSECONDS:.3f} s"


def encode(message: Any, *, ros: RosVersion) -> bytes:
    """The bytes of a message object in a version of ROS, with `depth_units` if it has them."""
    store, kind = typestore(ros), message.__msgtype__
    if ros == 2:
        return bytes(store.serialize_cdr(message, kind))
    unit = getattr(message, "depth_units", None)
    appended = b"" if unit is None else _UNIT.pack(unit)
    return bytes(store.serialize_ros1(message, kind)) + appended


def _decode_ros1(data: bytes, kind: str) -> Any:
    """A ROS 1 message, with the unit that librealsense appends to images it records.

    See librealsense, third-party/realsense-file/rosbag/msgs/sensor_msgs/Image.h: a float32 after
    the pixels where the header's frame_id is "1", which the message's definition does not tell.
    """
    kind = TRANSFORMS[0] if kind in TRANSFORMS else kind
    store = typestore(1)
    definition = store.get_msgdef(kind)
    message, end = definition.deserialize_ros1(data, 0, definition.cls, store)
    if kind == IMAGE and len(data) == end + _UNIT.size and message.header.frame_id == "1":
        (message.depth_units,) = _UNIT.unpack_from(data, end)
    elif end != len(data):
        raise ValueError(f"{len(data) - end} bytes too many")
    return message


def stamp_ns(header: Any) -> int:
    """Nanoseconds of a header's stamp."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)
