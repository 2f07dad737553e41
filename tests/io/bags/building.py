"""Small recordings, written by rosbags from the definitions of the messages."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("ros1", "sqlite3", "mcap", "mcap_file")
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, TF = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
SECOND = 10**9
# 12 September 2021, so that seconds and nanoseconds both matter
START = 1_631_450_000 * SECOND + 123_456_789
FOREVER = QosTime(2147483647, 4294967295)
QOS = [
    Qos(
        QosHistory.KEEP_LAST,
        7,
        QosReliability.BEST_EFFORT,
        QosDurability.VOLATILE,
        FOREVER,
        FOREVER,
        QosLiveliness.AUTOMATIC,
        FOREVER,
        avoid_ros_namespace_conventions=False,
    )
]


@dataclass
class Entry:
    """A message on its way into a recording; data: bytes to be written instead of the message."""

    topic: str
    time: int
    message: Any
    data: bytes | None = None


class Builder:
    """Makes messages of one version of ROS."""

    def __init__(self, ros: int) -> None:
        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        if ros == 1:  # not among the common messages
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF)
            )

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, stamp: int, frame_id: str) -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // SECOND, nanosec=stamp % SECOND)
        sequence = {"seq": 3} if self.ros == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id, **sequence)

    def image(
        self,
        pixels: NDArray[Any],
        encoding: str,
        stamp: int = START,
        frame_id: str = "camera",
        *,
        pad: int = 0,
        big_endian: bool = False,
    ) -> Any:
        """pad: bytes after each row."""
        order: Literal["<", ">"] = ">" if big_endian else "<"
        rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(order))
        flat = rows.view(np.uint8).reshape(len(rows), -1)
        flat = np.pad(flat, ((0, 0), (0, pad)), constant_values=255)
        return self.make(
            IMAGE,
            header=self.header(stamp, frame_id),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(big_endian),
            step=flat.shape[1],
            data=flat.reshape(-1),
        )

    def compressed(
        self, data: bytes, form: str, stamp: int = START, frame_id: str = "camera"
    ) -> Any:
        return self.make(
            COMPRESSED,
            header=self.header(stamp, frame_id),
            format=form,
            data=np.frombuffer(data, np.uint8),
        )

    def info(
        self,
        K: Sequence[float] = (50, 0, 4, 0, 50, 3, 0, 0, 1),
        size: tuple[int, int] = (6, 8),
        stamp: int = START,
        frame_id: str = "camera",
        P: Sequence[float] = (0,) * 12,
        D: Sequence[float] = (0.1, 0, 0, 0, 0),
    ) -> Any:
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        values = {"D": D, "K": K, "R": np.eye(3).ravel(), "P": P}
        matrices = {
            name if self.ros == 1 else name.lower(): np.asarray(value, np.float64)
            for name, value in values.items()
        }
        return self.make(
            INFO,
            header=self.header(stamp, frame_id),
            height=size[0],
            width=size[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **matrices,
        )

    def transform(self, matrix: NDArray[np.float64]) -> Any:
        """geometry_msgs/Transform of a rotation with a trace above -1."""
        w = np.sqrt(1 + np.trace(matrix[:3, :3])) / 2
        m = matrix
        q = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / (4 * w)
        rotation = self.make("geometry_msgs/msg/Quaternion", x=q[0], y=q[1], z=q[2], w=w)
        translation = self.make("geometry_msgs/msg/Vector3", x=m[0, 3], y=m[1, 3], z=m[2, 3])
        return self.make("geometry_msgs/msg/Transform", translation=translation, rotation=rotation)

    def transforms(self, *edges: tuple[str, str, NDArray[np.float64]]) -> Any:
        """TFMessage of (parent, child, child's points to parent's)."""
        stamped = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(START, parent),
                child_frame_id=child,
                transform=self.transform(matrix),
            )
            for parent, child, matrix in edges
        ]
        return self.make(TF, transforms=stamped)

    def serialized(self, entry: Entry) -> bytes:
        if entry.data is not None:
            return entry.data
        kind = entry.message.__msgtype__
        if self.ros == 1:
            return bytes(self.store.serialize_ros1(entry.message, kind))
        return bytes(self.store.serialize_cdr(entry.message, kind))


def builder_for(kind: str) -> Builder:
    return Builder(1 if kind == "ros1" else 2)


def bag_path(folder: Path, kind: str, name: str = "bag") -> Path:
    return folder / (name + {"ros1": ".bag", "mcap_file": ".mcap"}.get(kind, ""))


def write_bag(path: Path, kind: str, entries: Sequence[Entry], *, compressed: bool = False) -> Path:
    """Writes the messages in the order of their times; topics have the QoS, or the latching 1."""
    builder = builder_for(kind)
    if kind == "ros1":
        writer1 = Writer1(path)
        if compressed:
            writer1.set_compression(Writer1.CompressionFormat.LZ4)
        with writer1:
            _write(writer1, builder, entries, callerid="/driver", latching=1)
        return path
    plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
    folder = path.with_name(path.name + "_folder") if kind == "mcap_file" else path
    writer2 = Writer2(folder, version=8, storage_plugin=plugin)
    if compressed:
        mode = CompressionMode.MESSAGE if kind == "sqlite3" else CompressionMode.STORAGE
        writer2.set_compression(mode, CompressionFormat.ZSTD)
    with writer2:
        _write(writer2, builder, entries, offered_qos_profiles=QOS)
    if kind == "mcap_file":
        next(folder.glob("*.mcap")).rename(path)
    return path


def _write(writer: Any, builder: Builder, entries: Sequence[Entry], **properties: Any) -> None:
    connections: dict[str, Any] = {}
    for entry in sorted(entries, key=lambda entry: entry.time):
        if entry.topic not in connections:
            connections[entry.topic] = writer.add_connection(
                entry.topic, entry.message.__msgtype__, typestore=builder.store, **properties
            )
        writer.write(connections[entry.topic], entry.time, builder.serialized(entry))


def colour(i: int, size: tuple[int, int] = (6, 8)) -> NDArray[np.uint8]:
    """Another RGB image for each i."""
    return np.random.default_rng(i).integers(0, 256, (*size, 3), dtype=np.uint8)


def depth_mm(i: int, size: tuple[int, int] = (6, 8)) -> NDArray[np.uint16]:
    """Another depth map with holes for each i."""
    random = np.random.default_rng(1000 + i)
    depth = random.integers(300, 9000, size, dtype=np.uint16)
    return np.where(random.random(size) < 0.3, 0, depth).astype(np.uint16)


def camera_entries(builder: Builder, count: int = 5, period: int = SECOND // 30) -> list[Entry]:
    """A registered camera: colour, depth 4 ms later, camera_info; logged 10 ms later."""
    entries = []
    for i in range(count):
        t = START + i * period
        image = builder.image(colour(i), "rgb8", t, "camera")
        depth = builder.image(depth_mm(i), "16UC1", t + 4_000_000, "camera")
        entries += [
            Entry("/camera/color/image_raw", t + 10_000_000, image),
            Entry("/camera/color/camera_info", t + 10_000_000, builder.info(stamp=t)),
            Entry("/camera/depth/image_raw", t + 14_000_000, depth),
        ]
    return entries


def realsense_entries(builder: Builder, count: int = 3, *, unit: float = 0.001) -> list[Entry]:
    """What librealsense's recorder writes: see src/media/ros/ros_writer.cpp and the fork of
    sensor_msgs/Image.h there, which appends the unit where the frame_id is "1"."""
    depth_K, color_K = (50, 0, 4, 0, 50, 3, 0, 0, 1), (60, 0, 6, 0, 60, 4.5, 0, 0, 1)
    prefix = "/device_0/sensor_{}"
    depth, color = prefix.format(0) + "/Depth_0", prefix.format(1) + "/Color_0"
    to_color = np.eye(4)
    to_color[:3, 3] = 0.015, 0.0, 0.001
    static = 1  # rosbag's TIME_MIN
    value = builder.make("std_msgs/msg/Float32", data=unit)
    entries = [
        Entry("/file_version", static, builder.make("std_msgs/msg/UInt32", data=3)),
        Entry(prefix.format(0) + "/option/Depth Units/value", static, value),
        Entry(f"{depth}/info/camera_info", static, builder.info(depth_K, (6, 8), 0, "")),
        Entry(f"{color}/info/camera_info", static, builder.info(color_K, (9, 12), 0, "")),
        Entry(f"{depth}/tf/0", static, builder.transform(np.eye(4))),
        Entry(f"{color}/tf/0", static, builder.transform(to_color)),
    ]
    for i in range(count):
        t = START + i * SECOND // 30
        z16 = builder.image(depth_mm(i), "mono16", t, "1")
        rgb = builder.image(colour(i, (9, 12)), "rgb8", t + 2_000_000, "1")
        for topic, message, appended in ((depth, z16, unit), (color, rgb, 0.0)):
            entry = Entry(f"{topic}/image/data", 10_000_000 + i * SECOND // 30, message)
            entry.data = builder.serialized(entry) + struct.pack("<f", appended)
            entries.append(entry)
    return entries
