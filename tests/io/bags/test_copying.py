"""Copies: the originals byte for byte, the completed depth among them, all or nothing."""

import io
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag1, QosDurability
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import get_types_from_msg
from ruamel.yaml import YAML

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.bags import (
    ExtraMessage,
    Recording,
    completed_messages,
    copy_with,
    list_topics,
    open_recording,
)
from steered_marigold.io.bags.reading import open_reader, raw_messages
from tests.io.bags.building import (
    KINDS,
    QOS,
    SECOND,
    START,
    Builder,
    Entry,
    bag_path,
    builder_for,
    camera_entries,
    colour,
    depth_mm,
    realsense_entries,
    write_bag,
)

COMPLETED = "/camera/depth/image_raw/completed"
UNCERTAINTY = "/camera/depth/image_raw/completed/uncertainty"


def _completed(recording: Recording) -> Iterator[ExtraMessage]:
    """Depth of i + 1 metres everywhere, and an uncertainty of a tenth of it."""
    for i, frame in enumerate(recording.frames()):
        depth = torch.full(frame.decode().depth.shape, i + 1.0)
        yield from completed_messages(frame, depth, depth / 10).messages


def _contents(path: Path) -> list[tuple[str, str, int, bytes]]:
    """(topic, type, log time, data) of all messages."""
    with open_reader(path) as reader:
        return [
            (connection.topic, connection.msgtype, time, bytes(data))
            for connection, time, data in raw_messages(reader)
        ]


def _properties(path: Path) -> dict[str, tuple[Any, ...]]:
    """Type, definition, digest and QoS or latching of each topic."""
    with open_reader(path) as reader:
        return {
            each.topic: (each.msgtype, each.msgdef, each.digest, each.ext)
            for each in reader.connections
        }


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_originals_are_kept_byte_for_byte(tmp_path: Path, kind: str, compressed: bool) -> None:
    entries = camera_entries(builder_for(kind), 12)
    source = write_bag(bag_path(tmp_path, kind), kind, entries, compressed=compressed)
    out = bag_path(tmp_path, kind, "out")
    with open_recording(source) as recording:
        record = copy_with(recording, out, _completed(recording))
    assert (record.copied, record.added, record.path) == (36, 24, out)
    assert (record.unknown_types, record.attachments) == ((), 0)
    written = _contents(out)
    added = {COMPLETED, UNCERTAINTY}
    assert [item for item in written if item[0] not in added] == _contents(source)
    assert len(written) == 60
    times = [time for _, _, time, _ in written]
    assert times == sorted(times)
    before, after = _properties(source), _properties(out)
    if kind == "mcap_file":  # the format has no place for the digest
        before = {topic: (*rest[:2], "", rest[3]) for topic, rest in before.items()}
    for topic, properties in before.items():
        assert after[topic] == properties
    depth_ext = before["/camera/depth/image_raw"][3]
    if isinstance(depth_ext, ConnectionExtRosbag1):
        depth_ext = depth_ext._replace(callerid=None)
    assert after[COMPLETED][3] == depth_ext


@pytest.mark.parametrize("kind", KINDS)
def test_completed_depth_is_a_depth_topic(tmp_path: Path, kind: str) -> None:
    """Read by rosbags' own reader, and by ours as any recorded depth."""
    source = write_bag(bag_path(tmp_path, kind), kind, camera_entries(builder_for(kind), 4))
    out = bag_path(tmp_path, kind, "out")
    with open_recording(source) as recording:
        copy_with(recording, out, _completed(recording))
    with AnyReader([out]) as reader:
        for topic, scale in ((COMPLETED, 1.0), (UNCERTAINTY, 0.1)):
            connections = [each for each in reader.connections if each.topic == topic]
            read = list(reader.messages(connections))
            assert len(read) == 4
            for i, (connection, time, data) in enumerate(read):
                message: Any = reader.deserialize(data, connection.msgtype)
                assert message.header.frame_id == "camera"
                stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
                assert stamp == START + i * (SECOND // 30) + 4_000_000
                assert time == stamp + 10_000_000
                codes = message.data.view("<u2" if topic == COMPLETED else "<f4")
                unit = 0.001 if topic == COMPLETED else 1.0
                assert np.allclose(codes * unit, (i + 1) * scale)
    with open_recording(out, depth_topic=COMPLETED) as recording:
        frames = [frame.decode() for frame in recording.frames()]
    assert [float(frame.depth.mean()) for frame in frames] == [1.0, 2.0, 3.0, 4.0]
    assert all(frame.valid_mask.all() for frame in frames)


@pytest.mark.parametrize("kind", KINDS)
def test_a_completed_recording_is_one_as_before(tmp_path: Path, kind: str) -> None:
    """The added topics are no candidates, and completing it again is refused."""
    source = write_bag(bag_path(tmp_path, kind), kind, camera_entries(builder_for(kind), 2))
    out, again = bag_path(tmp_path, kind, "out"), bag_path(tmp_path, kind, "again")
    with open_recording(source) as recording:
        copy_with(recording, out, _completed(recording))
    with open_recording(out) as recording:
        assert recording.depth_topic == "/camera/depth/image_raw"
        with pytest.raises(InputError, match=f"has a topic {COMPLETED} already"):
            copy_with(recording, again, _completed(recording))
    assert not again.exists()


def test_compressed_depth_keeps_its_transport_in_the_name(tmp_path: Path) -> None:
    builder = Builder(2)
    entries = camera_entries(builder, 1)[:2]
    png = io.BytesIO()
    Image.fromarray(depth_mm(0)).save(png, "PNG")
    depth = builder.compressed(bytes(12) + png.getvalue(), "16UC1; compressedDepth png")
    entries.append(Entry("/camera/depth/image_raw/compressedDepth", START + 1, depth))
    source = write_bag(tmp_path / "bag", "mcap", entries)
    with open_recording(source) as recording:
        copy_with(recording, tmp_path / "out", _completed(recording))
    name = "/camera/depth/image_raw/completed/compressedDepth"
    with open_recording(tmp_path / "out", depth_topic=name) as recording:
        assert float(next(iter(recording.frames())).decode().depth.mean()) == 1.0
    assert UNCERTAINTY in {topic.name for topic in list_topics(tmp_path / "out")}


@pytest.mark.parametrize("unit", [0.001, 0.00025])
def test_realsense_depth_keeps_its_unit(tmp_path: Path, unit: float) -> None:
    """The appended unit is in the added messages too; registered depth has the image's size."""
    source = write_bag(tmp_path / "rs.bag", "ros1", realsense_entries(Builder(1), unit=unit))
    with open_recording(source) as recording:
        extra = (
            message
            for frame in recording.frames()
            for message in completed_messages(frame, torch.full((9, 12), 3.0)).messages
        )
        copy_with(recording, tmp_path / "out.bag", extra)
    originals = [item for item in _contents(tmp_path / "out.bag") if "completed" not in item[0]]
    assert originals == _contents(source)
    name = "/device_0/sensor_0/Depth_0/image/data/completed"
    added = [item for item in _contents(tmp_path / "out.bag") if item[0] == name]
    assert len(added) == 3
    codes = np.frombuffer(added[0][3][-9 * 12 * 2 - 4 : -4], "<u2")
    assert (codes == round(3.0 / unit)).all()
    assert struct.unpack("<f", added[0][3][-4:])[0] == pytest.approx(unit)


def test_registered_depth_gets_the_frame_of_the_image(tmp_path: Path) -> None:
    builder = Builder(2)
    still = builder.transforms(("color", "depth", np.eye(4)))
    entries = [
        Entry("/c/color/image_raw", START, builder.image(colour(0), "rgb8", frame_id="color")),
        Entry("/c/depth/image_raw", START, builder.image(depth_mm(0), "16UC1", frame_id="depth")),
        Entry("/c/color/camera_info", START, builder.info()),
        Entry("/c/depth/camera_info", START, builder.info()),
        Entry("/tf_static", START, still),
    ]
    source = write_bag(tmp_path / "bag", "mcap", entries)
    with open_recording(source) as recording:
        frame = next(iter(recording.frames()))
        message = completed_messages(frame, torch.ones(6, 8)).messages[0]
    decoded = builder.store.deserialize_cdr(message.data, message.type)
    assert decoded.header.frame_id == "color"  # type: ignore[attr-defined]


@pytest.mark.parametrize("out_name", ["out", "out.mcap"])
@pytest.mark.parametrize("kind", ["sqlite3", "mcap", "ros1"])
def test_any_recording_becomes_mcap(tmp_path: Path, kind: str, out_name: str) -> None:
    entries = camera_entries(builder_for(kind), 5)
    source = write_bag(bag_path(tmp_path, kind), kind, entries)
    with open_recording(source) as recording:
        copy_with(recording, tmp_path / out_name, _completed(recording), format="mcap")
    expected, written = _contents(source), _contents(tmp_path / out_name)
    originals = [item for item in written if "completed" not in item[0]]
    assert [item[:3] for item in originals] == [item[:3] for item in expected]
    if kind != "ros1":
        assert originals == expected
    with open_recording(source) as before, open_recording(tmp_path / out_name) as after:
        for old, new in zip(before.frames(), after.frames(), strict=True):
            assert old.stamp_ns == new.stamp_ns
            assert torch.equal(old.decode().image, new.decode().image)
            assert torch.equal(old.decode().depth, new.decode().depth)
            assert torch.equal(old.decode().K, new.decode().K)  # type: ignore[arg-type]


def test_ros1_becomes_ros2_with_its_own_types_and_latching(tmp_path: Path) -> None:
    """A type that only the recording defines, TF of the old name, and latched topics."""
    path = tmp_path / "a.bag"
    builder = Builder(1)
    builder.store.register(
        get_types_from_msg("Header header\nfloat64 volts\nstring[] names", "robot_msgs/msg/Battery")
    )
    entries = camera_entries(builder, 2)
    battery = builder.make(
        "robot_msgs/msg/Battery",
        header=builder.header(START, "base"),
        volts=11.5,
        names=["left", "right"],
    )
    with Writer1(path) as writer:
        connections = {}
        for entry in [Entry("/battery", START, battery), *entries]:
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(
                    entry.topic,
                    entry.message.__msgtype__,
                    typestore=builder.store,
                    latching=1 if entry.topic == "/battery" else None,
                )
            data = builder.store.serialize_ros1(entry.message, entry.message.__msgtype__)
            writer.write(connections[entry.topic], entry.time, data)
    with open_recording(path) as recording:
        copy_with(recording, tmp_path / "out", [], format="mcap")
    with AnyReader([tmp_path / "out"]) as reader:
        connection = next(each for each in reader.connections if each.topic == "/battery")
        assert connection.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL  # type: ignore[union-attr]
        _, _, raw = next(reader.messages([connection]))
        read: Any = reader.deserialize(raw, connection.msgtype)
    assert (read.volts, read.names) == (11.5, ["left", "right"])
    assert read.header.frame_id == "base"


@pytest.mark.parametrize("form", [None, "mcap"])
def test_publishers_of_one_topic_may_be_several(tmp_path: Path, form: Any) -> None:
    """As of /tf; ROS 1 tells them apart, ROS 2 does not."""
    builder, path = Builder(1), tmp_path / "a.bag"
    still = builder.transforms(("base", "camera", np.eye(4)))
    with Writer1(path) as writer:
        publishers = [
            writer.add_connection(
                "/tf", still.__msgtype__, typestore=builder.store, callerid=f"/node{i}"
            )
            for i in range(2)
        ]
        connections: dict[str, Any] = {}
        for i, entry in enumerate(camera_entries(builder, 2)):
            tf = Entry("/tf", entry.time, still)
            writer.write(publishers[i % 2], tf.time, builder.serialized(tf))
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(
                    entry.topic, entry.message.__msgtype__, typestore=builder.store
                )
            writer.write(connections[entry.topic], entry.time, builder.serialized(entry))
    out = tmp_path / ("out" if form else "out.bag")
    with open_recording(path) as recording:
        copy_with(recording, out, [], format=form)
    assert [item[:3] for item in _contents(out)] == [item[:3] for item in _contents(path)]
    with open_reader(out) as reader:
        tf_connections = [each for each in reader.connections if each.topic == "/tf"]
    assert len(tf_connections) == (1 if form else 2)


def test_messages_that_cannot_be_converted_are_named(tmp_path: Path) -> None:
    builder, path = Builder(1), tmp_path / "a.bag"
    entries = camera_entries(builder, 1)
    text = builder.make("std_msgs/msg/String", data="twelve")
    entries.append(Entry("/damaged", START, text, data=b"\xff\xff\xff\x7f"))
    write_bag(path, "ros1", entries)
    with open_recording(path) as recording:
        copy_with(recording, tmp_path / "out.bag", [])  # bytes are bytes
        with pytest.raises(InputError, match=r"std_msgs/msg/String of /damaged cannot be conv"):
            copy_with(recording, tmp_path / "out", [], format="mcap")
    assert not (tmp_path / "out").exists()


def test_realsense_becomes_mcap_where_ros2_can_tell_its_unit(tmp_path: Path) -> None:
    for unit, name in ((0.001, "millimetres"), (0.00025, "quarters")):
        path = tmp_path / f"{name}.bag"
        source = write_bag(path, "ros1", realsense_entries(Builder(1), unit=unit))
        with open_recording(source) as recording:
            if unit == 0.001:
                copy_with(recording, tmp_path / name, [], format="mcap")
                continue
            with pytest.raises(InputError, match=r"units of 0\.00025 m"):
                copy_with(recording, tmp_path / name, [], format="mcap")
    assert not (tmp_path / "quarters").exists()
    with open_recording(tmp_path / "millimetres") as recording:
        depth = next(iter(recording.frames())).decode().depth
    assert torch.allclose(depth, torch.from_numpy((depth_mm(0) * 0.001).astype(np.float32)))


def _robot_recording(folder: Path) -> Path:
    """An sqlite3 recording as Humble makes it: without definitions, with a type of its own."""
    builder = Builder(2)
    builder.store.register(get_types_from_msg("float64 volts", "robot_msgs/msg/Battery"))
    battery = builder.make("robot_msgs/msg/Battery", volts=11.5)
    path = folder / "humble"
    writer = Writer2(path, version=8, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        connections: dict[str, Any] = {}
        for entry in [Entry("/battery", START, battery), *camera_entries(builder, 3)]:
            kind = entry.message.__msgtype__
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(
                    entry.topic, kind, typestore=builder.store, offered_qos_profiles=QOS
                )
            data = builder.store.serialize_cdr(entry.message, kind)
            writer.write(connections[entry.topic], entry.time, data)
    with sqlite3.connect(next(path.glob("*.db3"))) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
        database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
    database.close()
    yaml = YAML(typ="safe")
    metadata = yaml.load((path / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    information["version"] = 5
    for topic in information["topics_with_message_count"]:
        del topic["topic_metadata"]["type_description_hash"]
    del information["ros_distro"], information["custom_data"]
    with (path / "metadata.yaml").open("w") as file:
        yaml.dump(metadata, file)
    return path


@pytest.mark.parametrize("form", [None, "mcap"])
def test_types_without_definition_are_copied_and_named(tmp_path: Path, form: Any) -> None:
    source = _robot_recording(tmp_path)
    with open_recording(source) as recording:
        record = copy_with(recording, tmp_path / "out", _completed(recording), format=form)
    assert record.unknown_types == ("robot_msgs/msg/Battery",)
    originals = [item for item in _contents(tmp_path / "out") if "completed" not in item[0]]
    assert originals == _contents(source)
    with AnyReader([tmp_path / "out"]) as reader:  # the other topics can be read by anybody
        connection = next(each for each in reader.connections if each.topic == COMPLETED)
        assert len(list(reader.messages([connection]))) == 3


def test_metadata_is_what_ros2_bag_info_reads(tmp_path: Path) -> None:
    """The keys of rosbag2's metadata_io of version 8, and counts that are true."""
    source = write_bag(tmp_path / "bag", "sqlite3", camera_entries(Builder(2), 4))
    for form in ("sqlite3", "mcap"):
        out = tmp_path / f"out_{form}"
        with open_recording(source) as recording:
            copy_with(recording, out, _completed(recording), format=form)
        text = (out / "metadata.yaml").read_text()
        information = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
        assert information["version"] == 8
        assert information["storage_identifier"] == form
        assert information["message_count"] == 20
        (name,) = information["relative_file_paths"]
        assert (out / name).is_file()
        assert name.startswith(out.name)
        first = information["starting_time"]["nanoseconds_since_epoch"]
        assert first == START + 10_000_000
        assert information["duration"]["nanoseconds"] == 3 * (SECOND // 30) + 4_000_000
        counts = {
            each["topic_metadata"]["name"]: each["message_count"]
            for each in information["topics_with_message_count"]
        }
        assert counts[COMPLETED] == counts["/camera/color/image_raw"] == 4
        for each in information["topics_with_message_count"]:
            metadata = each["topic_metadata"]
            assert metadata["serialization_format"] == "cdr"
            assert isinstance(metadata["offered_qos_profiles"], str)
            assert metadata["type_description_hash"].startswith("RIHS01_")


def _mcap_summary(data: bytes) -> dict[int, list[bytes]]:
    """The records of the summary section by their opcode, by the specification of MCAP."""
    magic = b"\x89MCAP0\r\n"
    assert data.startswith(magic)
    assert data.endswith(magic)
    opcode, length, start, offsets, _ = struct.unpack_from("<BQQQI", data, len(data) - 8 - 29)
    assert (opcode, length) == (0x02, 20)
    assert 0 < start < offsets < len(data)
    records: dict[int, list[bytes]] = {}
    place = start
    while place < len(data) - 8 - 29:
        opcode, length = struct.unpack_from("<BQ", data, place)
        records.setdefault(opcode, []).append(data[place + 9 : place + 9 + length])
        place += 9 + length
    return records


def test_mcap_has_indexes_that_point_at_chunks(tmp_path: Path) -> None:
    """What Foxglove needs for seeking: schemas, channels, chunk indexes and statistics."""
    big = [colour(i, (200, 300)) for i in range(8)]
    builder = Builder(2)
    entries = camera_entries(builder, 8)
    for i, entry in enumerate(each for each in entries if each.topic.endswith("color/image_raw")):
        entry.message = builder.image(big[i], "rgb8", START + i * SECOND // 30)
    source = write_bag(tmp_path / "bag", "mcap", entries)
    with open_recording(source) as recording:
        extra = (
            message
            for frame in recording.frames()
            for message in completed_messages(frame, torch.ones(200, 300)).messages
        )
        copy_with(recording, tmp_path / "out.mcap", extra)
    data = (tmp_path / "out.mcap").read_bytes()
    records = _mcap_summary(data)
    assert {len(records[0x03]), len(records[0x04])} == {2, 4}
    assert len(records[0x08]) >= 2
    total = 0
    for record in records[0x08]:
        first, last, offset, length = struct.unpack_from("<QQQQ", record)
        assert first <= last
        opcode, chunk_length = struct.unpack_from("<BQ", data, offset)
        assert (opcode, chunk_length + 9) == (0x06, length)
        (map_length,) = struct.unpack_from("<I", record, 32)
        for place in range(36, 36 + map_length, 10):
            channel, index = struct.unpack_from("<HQ", record, place)
            kind, _, of, entries_length = struct.unpack_from("<BQHI", data, index)
            assert (kind, of) == (0x07, channel)
            total += entries_length // 16
    count, _, channel_count = struct.unpack_from("<QHI", records[0x0B][0])
    assert (count, channel_count) == (total, 4) == (32, 4)


class _InterruptError(Exception):
    """Stands for whatever stops a run."""


@pytest.mark.parametrize("stop", [_InterruptError, KeyboardInterrupt])
@pytest.mark.parametrize("kind", KINDS)
def test_an_interrupted_copy_leaves_nothing(tmp_path: Path, kind: str, stop: Any) -> None:
    source = write_bag(bag_path(tmp_path, kind), kind, camera_entries(builder_for(kind), 6))

    def extra(recording: Recording) -> Iterator[ExtraMessage]:
        messages = _completed(recording)
        yield next(messages)
        yield next(messages)
        raise stop

    before = sorted(tmp_path.rglob("*"))
    with open_recording(source) as recording, pytest.raises(stop):
        copy_with(recording, bag_path(tmp_path, kind, "out"), extra(recording))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("kind", KINDS)
def test_an_existing_output_is_kept_unless_it_may_go(tmp_path: Path, kind: str) -> None:
    source = write_bag(bag_path(tmp_path, kind), kind, camera_entries(builder_for(kind), 3))
    out = bag_path(tmp_path, kind, "out")
    with open_recording(source) as recording:
        copy_with(recording, out, [])
        before = _contents(out)
        with pytest.raises(InputError, match="exists; remove it, or set `overwrite`"):
            copy_with(recording, out, _completed(recording))
        assert _contents(out) == before
        with pytest.raises(FileFormatError):  # a failed run keeps the older one too
            copy_with(recording, out, _failing(), overwrite=True)
        assert _contents(out) == before
        copy_with(recording, out, _completed(recording), overwrite=True)
    assert len(_contents(out)) == 15
    with (
        open_recording(source) as recording,
        pytest.raises(InputError, match="the recording itself"),
    ):
        copy_with(recording, source, [], overwrite=True)
    assert len(_contents(source)) == 9
    assert not list(tmp_path.glob(".*"))


def _failing() -> Iterator[ExtraMessage]:
    raise FileFormatError("the frame is damaged")
    yield


@pytest.mark.parametrize(
    ("kind", "out", "form", "reason"),
    [
        ("ros1", "out", None, "needs the extension .bag"),
        ("ros1", "out.bag", "mcap", "mcap is written as a folder"),
        ("sqlite3", "out.db3", None, "name one without an extension"),
        ("mcap", "out", "rosbag", "`format` is mcap or sqlite3"),
        ("mcap", "nowhere/out", None, "there is no folder"),
    ],
)
def test_outputs_that_do_not_fit_are_refused(
    tmp_path: Path, kind: str, out: str, form: Any, reason: str
) -> None:
    source = write_bag(bag_path(tmp_path, kind), kind, camera_entries(builder_for(kind), 1))
    with open_recording(source) as recording, pytest.raises(InputError, match=reason):
        copy_with(recording, tmp_path / out, [], format=form)


def test_topics_without_messages_stay_in_the_list(tmp_path: Path) -> None:
    builder = Builder(2)
    path = tmp_path / "bag"
    writer = Writer2(path, version=8, storage_plugin=StoragePlugin.MCAP)
    with writer:
        writer.add_connection("/silent", "std_msgs/msg/String", typestore=builder.store)
        connections: dict[str, Any] = {}
        for entry in camera_entries(builder, 1):
            kind = entry.message.__msgtype__
            connection = connections.setdefault(
                entry.topic, writer.add_connection(entry.topic, kind, typestore=builder.store)
            )
            writer.write(connection, entry.time, builder.serialized(entry))
    with open_recording(path) as recording:
        copy_with(recording, tmp_path / "out", [])
    assert "/silent" in {topic.name for topic in list_topics(tmp_path / "out")}


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_real_frames_survive(tmp_path: Path, sequence: Path, kind: str) -> None:
    """Frames of a Kinect, read back equal from the copy."""
    builder = builder_for(kind)
    entries, frames = [], []
    for i in range(0, 40, 8):
        rgb = np.asarray(Image.open(sequence / "rgb" / f"{i:04}.jpg"))
        depth = np.asarray(Image.open(sequence / "depth" / f"{i:04}.png")).astype(np.uint16)
        frames.append((rgb, depth))
        t = START + i * SECOND // 30
        entries.append(Entry("/rgb/image_raw", t, builder.image(rgb[..., ::-1], "bgr8", t)))
        entries.append(Entry("/depth/image_raw", t, builder.image(depth, "16UC1", t)))
    source = write_bag(bag_path(tmp_path, kind), kind, entries)
    out = bag_path(tmp_path, kind, "out")
    with open_recording(source) as recording:
        extra = (
            message
            for frame in recording.frames()
            for message in completed_messages(frame, frame.decode().depth).messages
        )
        copy_with(recording, out, extra)
    for topic in (None, "/depth/image_raw/completed"):
        with open_recording(out, depth_topic=topic) as recording:
            for (rgb, depth), frame in zip(frames, recording.frames(), strict=True):
                decoded = frame.decode()
                assert np.array_equal(decoded.image.numpy(), rgb)
                known = (depth > 0) & (depth < 65535)
                assert np.array_equal(decoded.valid_mask.numpy(), known)
                metres = (depth * 0.001).astype(np.float32)
                assert np.array_equal(decoded.depth.numpy(), np.where(known, metres, 0))


_LONG_RUN = """
import sys
from pathlib import Path
from steered_marigold.io.bags import completed_messages, copy_with, open_recording
with open_recording(sys.argv[1]) as recording:
    extra = (
        message
        for frame in recording.frames()
        for message in completed_messages(frame, frame.decode().depth).messages
    )
    record = copy_with(recording, sys.argv[2], extra)
(largest,) = [line for line in Path("/proc/self/status").open() if line.startswith("VmHWM")]
print(record.copied, record.added, largest.split()[1])
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells the memory")
@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_memory_stays_flat_over_ten_thousand_frames(tmp_path: Path, kind: str) -> None:
    """The largest memory of a process that copies 100 and 10 000 frames differs by the index.

    A frame is 13 kB of image and depth, so that 10 000 are 130 MB.
    """
    memory = {}
    for count in (100, 10_000):
        builder = builder_for(kind)
        entries = (_small_frame(builder, i) for i in range(count))
        source = bag_path(tmp_path, kind, f"in{count}")
        write_bag(source, kind, [entry for pair in entries for entry in pair])
        out = bag_path(tmp_path, kind, f"out{count}")
        command = [sys.executable, "-c", _LONG_RUN, str(source), str(out)]
        run = subprocess.run(command, check=True, capture_output=True, text=True)
        copied, added, kilobytes = map(int, run.stdout.split())
        assert (copied, added) == (2 * count, count)
        memory[count] = kilobytes / 1000
    assert memory[10_000] - memory[100] < 40


def _small_frame(builder: Builder, i: int) -> list[Entry]:
    t = START + i * SECOND // 30
    depth = np.full((48, 56), 1000 + i % 500, np.uint16)
    image = np.full((48, 56, 3), i % 256, np.uint8)
    return [
        Entry("/rgb", t, builder.image(image, "rgb8", t)),
        Entry("/depth", t, builder.image(depth, "16UC1", t)),
    ]
