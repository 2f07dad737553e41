"""Recordings of all kinds, read back."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.bags import RecordedFrame, Topic, list_topics, open_recording
from tests.io.bags.building import (
    KINDS,
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


def _camera_bag(folder: Path, kind: str, count: int = 5, *, compressed: bool = False) -> Path:
    entries = camera_entries(builder_for(kind), count)
    return write_bag(bag_path(folder, kind), kind, entries, compressed=compressed)


def _shift(x: float, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_read_as_they_were_written(tmp_path: Path, kind: str, compressed: bool) -> None:
    with open_recording(_camera_bag(tmp_path, kind, compressed=compressed)) as recording:
        assert recording.image_topic == "/camera/color/image_raw"
        assert recording.depth_topic == "/camera/depth/image_raw"
        assert recording.info_topic == "/camera/color/camera_info"
        assert recording.depth_count == 5
        stream = recording.frames()
        frames = list(stream)
    assert (stream.counts.paired, stream.counts.unpaired_images) == (5, 0)
    for i, frame in enumerate(frames):
        assert frame.index == i
        assert frame.stamp_ns == START + i * (SECOND // 30) + 4_000_000
        assert frame.stamp_s == frame.stamp_ns / SECOND
        decoded = frame.decode()
        assert torch.equal(decoded.image, torch.from_numpy(colour(i)))
        assert torch.equal(decoded.valid_mask, torch.from_numpy(depth_mm(i) > 0))
        metres = (depth_mm(i) * 0.001).astype(np.float32)
        assert torch.equal(decoded.depth, torch.from_numpy(metres))
        assert decoded.extrinsics is None
        assert decoded.K is not None
        assert decoded.K.flatten().tolist() == [50, 0, 4, 0, 50, 3, 0, 0, 1]
        assert frame.camera is not None
        assert frame.camera.distortion == (0.1, 0, 0, 0, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_topics_are_listed(tmp_path: Path, kind: str) -> None:
    topics = list_topics(_camera_bag(tmp_path, kind, 3))
    assert topics[1] == Topic(name="/camera/color/image_raw", type="sensor_msgs/msg/Image", count=3)
    assert [topic.count for topic in topics] == [3, 3, 3]


def test_a_db3_file_is_a_recording(tmp_path: Path) -> None:
    path = next(_camera_bag(tmp_path, "sqlite3", 2).glob("*.db3"))
    with open_recording(path) as recording:
        assert len(list(recording.frames())) == 2


def test_realsense_recordings_have_cameras_units_and_extrinsics(tmp_path: Path) -> None:
    """Depth in 0.25 mm, as an L515 has it, not registered; colour is 15 mm beside it."""
    path = write_bag(tmp_path / "rs.bag", "ros1", realsense_entries(Builder(1), unit=0.00025))
    with open_recording(path) as recording:
        assert recording.depth_topic == "/device_0/sensor_0/Depth_0/image/data"
        assert recording.image_topic == "/device_0/sensor_1/Color_0/image/data"
        frame = list(recording.frames())[1].decode()
    assert frame.image.shape == (9, 12, 3)
    metres = (depth_mm(1) * 0.00025).astype(np.float32)
    assert torch.allclose(frame.depth, torch.from_numpy(metres))
    assert frame.K is not None
    assert frame.K[0, 0] == 60
    assert frame.depth_K is not None
    assert frame.depth_K[0, 0] == 50
    assert frame.extrinsics is not None
    assert torch.allclose(frame.extrinsics[:3, 3], torch.tensor([0.015, 0.0, 0.001]))


def test_older_realsense_recordings_tell_the_unit_as_an_option(tmp_path: Path) -> None:
    """File version 2: nothing is appended to the images."""
    builder = Builder(1)
    entries = realsense_entries(builder, unit=0.0005)
    for entry in entries:
        entry.data = None
    with open_recording(write_bag(tmp_path / "rs.bag", "ros1", entries)) as recording:
        frame = next(iter(recording.frames())).decode()
    metres = (depth_mm(0) * 0.0005).astype(np.float32)
    assert torch.allclose(frame.depth, torch.from_numpy(metres))


def _unregistered(builder: Builder, frames: tuple[str, str] = ("color", "depth")) -> list[Entry]:
    color_frame, depth_frame = frames
    info = builder.info((60, 0, 6, 0, 60, 4.5, 0, 0, 1), (9, 12), START, color_frame)
    return [
        Entry("/c/color/image_raw", START, builder.image(colour(0), "rgb8", START, color_frame)),
        Entry("/c/depth/image_raw", START, builder.image(depth_mm(0), "16UC1", START, depth_frame)),
        Entry("/c/color/camera_info", START, info),
        Entry("/c/depth/camera_info", START, builder.info(frame_id=depth_frame)),
    ]


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
@pytest.mark.parametrize("kind", KINDS)
def test_extrinsics_come_from_a_chain_of_transforms(tmp_path: Path, kind: str, topic: str) -> None:
    """Both optical frames hang below frames of their own on the camera's link."""
    builder = builder_for(kind)
    turn = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    tree = [
        ("link", "color_link", _shift(0, 0.06)),
        ("link", "depth_link", _shift(0, 0.01)),
        ("color_link", "color", turn),
        ("depth_link", "depth", turn),
    ]
    entries = _unregistered(builder)
    for repeat in range(3 if topic == "/tf" else 1):
        moving = ("odom", "link", _shift(0.1 * repeat))
        edges = [*tree, moving] if topic == "/tf" else tree
        entries.append(Entry(topic, START + repeat, builder.transforms(*edges)))
    with open_recording(write_bag(bag_path(tmp_path, kind), kind, entries)) as recording:
        frame = next(iter(recording.frames())).decode()
    assert frame.extrinsics is not None
    # 5 cm along the link's y, which is the camera's -x
    expected = torch.from_numpy(_shift(0.05)).float()
    assert torch.allclose(frame.extrinsics, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("leave_out", "missing"),
    [
        ("/c/depth/camera_info", "the camera_info of /c/depth/image_raw"),
        ("/tf_static", "a fixed transform from 'depth' to 'color'"),
    ],
)
def test_unregistered_depth_without_what_registering_takes_is_refused(
    tmp_path: Path, leave_out: str, missing: str
) -> None:
    builder = Builder(2)
    still = builder.transforms(("color", "depth", _shift(0.05)))
    entries = [*_unregistered(builder), Entry("/tf_static", START, still)]
    entries = [entry for entry in entries if entry.topic != leave_out]
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with pytest.raises(InputError, match=missing), open_recording(path):
        pass


def test_a_moving_transform_is_none(tmp_path: Path) -> None:
    builder = Builder(2)
    entries = _unregistered(builder)
    for i in range(2):
        moved = builder.transforms(("color", "depth", _shift(0.05 + i)))
        entries.append(Entry("/tf", START + i, moved))
    path = write_bag(tmp_path / "bag", "mcap", entries)
    with pytest.raises(InputError, match="a fixed transform"), open_recording(path):
        pass


def test_registered_depth_wins_over_depth_as_measured(tmp_path: Path) -> None:
    builder = Builder(2)
    aligned = builder.image(depth_mm(7), "16UC1", START, "aligned_frame")
    entries = [
        *_unregistered(builder),
        Entry("/c/aligned_depth_to_color/image_raw", START, aligned),
        Entry("/c/infra1/image_rect_raw", START, builder.image(depth_mm(8), "16UC1", START)),
    ]
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        assert recording.depth_topic == "/c/aligned_depth_to_color/image_raw"
        frame = next(iter(recording.frames())).decode()
    assert frame.extrinsics is None
    assert frame.depth[0, 0] == float(np.float32(depth_mm(7)[0, 0] * 0.001))


def test_raw_topics_win_over_their_compressed_twins(tmp_path: Path) -> None:
    builder = Builder(2)
    jpeg = builder.compressed(b"no jpeg", "rgb8; jpeg compressed bgr8")
    entries = [
        *camera_entries(builder, 2),
        Entry("/camera/color/image_raw/compressed", START, jpeg),
    ]
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        assert recording.image_topic == "/camera/color/image_raw"


def test_several_candidates_are_listed(tmp_path: Path) -> None:
    builder = Builder(2)
    other = builder.image(colour(0), "bgr8", START)
    entries = [*camera_entries(builder, 2), Entry("/other/image_raw", START, other)]
    path = write_bag(tmp_path / "bag", "sqlite3", entries)
    with pytest.raises(InputError) as raised, open_recording(path):
        pass
    message = str(raised.value)
    assert "`image_topic`" in message
    assert "/other/image_raw (sensor_msgs/msg/Image, 1 messages)" in message
    assert "/camera/color/image_raw (sensor_msgs/msg/Image, 2 messages)" in message
    with open_recording(path, image_topic="/other/image_raw") as recording:
        assert recording.image_topic == "/other/image_raw"


@pytest.mark.parametrize("argument", ["image_topic", "depth_topic", "info_topic"])
def test_a_topic_that_is_not_there_is_refused(tmp_path: Path, argument: str) -> None:
    path = _camera_bag(tmp_path, "mcap", 1)
    arguments = {argument: "/nothing"}
    with (
        pytest.raises(InputError, match=f"`{argument}`.*no /nothing"),
        open_recording(path, **arguments),
    ):
        pass


def test_a_recording_without_depth_says_so(tmp_path: Path) -> None:
    builder = Builder(1)
    entries = [Entry("/a", START, builder.image(colour(0), "rgb8"))]
    path = write_bag(tmp_path / "a.bag", "ros1", entries)
    reason = "no topic is depth; name one as `depth_topic`: /a"
    with pytest.raises(InputError, match=reason), open_recording(path):
        pass


def _indices(frames: list[RecordedFrame]) -> list[int]:
    """Which of the camera's frames these are."""
    return [round((frame.stamp_ns - START - 4_000_000) / (SECOND // 30)) for frame in frames]


def test_every_start_and_duration_choose_frames(tmp_path: Path) -> None:
    with open_recording(_camera_bag(tmp_path, "mcap", 30)) as recording:
        assert _indices(list(recording.frames(every=7))) == [0, 7, 14, 21, 28]
        later = recording.frames(start=0.499)
        assert _indices(list(later)) == list(range(15, 30))
        part = recording.frames(start=0.499, duration=0.2)
        assert _indices(list(part)) == list(range(15, 21))
        assert (part.counts.paired, part.counts.unpaired_depths) == (6, 0)


@pytest.mark.parametrize(
    ("argument", "value"),
    [("slop", -1.0), ("every", 0), ("start", float("nan")), ("duration", float("inf"))],
)
def test_arguments_out_of_range_are_refused(tmp_path: Path, argument: str, value: float) -> None:
    arguments: dict[str, Any] = {argument: value}
    with (
        open_recording(_camera_bag(tmp_path, "mcap", 1)) as recording,
        pytest.raises(InputError, match=f"`{argument}`"),
    ):
        recording.frames(**arguments)


def test_what_has_no_partner_is_counted(tmp_path: Path) -> None:
    builder = Builder(2)
    entries = camera_entries(builder, 6)
    lone = [entry for entry in entries if entry.topic == "/camera/color/image_raw"][2]
    entries.remove(lone)
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        stream = recording.frames()
        assert _indices(list(stream)) == [0, 1, 3, 4, 5]
        assert stream.counts.unpaired_depths == 1
        strict = recording.frames(slop=0.003)
        assert list(strict) == []
        assert (strict.counts.unpaired_images, strict.counts.unpaired_depths) == (5, 6)


def test_the_camera_may_change(tmp_path: Path) -> None:
    """K is the one that was last sent before a frame's depth."""
    builder = Builder(2)
    entries = camera_entries(builder, 4)
    zoomed = builder.info((100, 0, 4, 0, 100, 3, 0, 0, 1))
    for entry in entries:
        if "camera_info" in entry.topic and entry.time > START + SECOND // 15:
            entry.message = zoomed
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        focal = [float(frame.camera.K[0, 0]) for frame in recording.frames() if frame.camera]
    assert focal == [50, 50, 100, 100]


def test_a_rectified_image_has_the_rectified_camera(tmp_path: Path) -> None:
    builder = Builder(2)
    P = (55, 0, 5, 0, 0, 55, 4, 0, 0, 0, 1, 0)
    entries = [
        Entry("/c/image_rect_color", START, builder.image(colour(0), "rgb8")),
        Entry("/c/depth/image_raw", START, builder.image(depth_mm(0), "16UC1")),
        Entry("/c/camera_info", START, builder.info(P=P)),
    ]
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        frame = next(iter(recording.frames()))
    assert frame.camera is not None
    assert frame.camera.K.flatten().tolist() == [55, 0, 5, 0, 55, 4, 0, 0, 1]
    assert frame.camera.distortion == (0, 0, 0, 0, 0)


def test_K_fits_the_size_of_the_image(tmp_path: Path) -> None:  # noqa: N802
    """A camera_info of the full resolution beside an image of half of it."""
    builder = Builder(2)
    entries = camera_entries(builder, 1)
    for entry in entries:
        if "camera_info" in entry.topic:
            entry.message = builder.info((100, 0, 7.5, 0, 100, 5.5, 0, 0, 1), (12, 16))
    with open_recording(write_bag(tmp_path / "bag", "mcap", entries)) as recording:
        K = next(iter(recording.frames())).decode().K
    assert K is not None
    assert K.flatten().tolist() == [50, 0, 3.5, 0, 50, 2.5, 0, 0, 1]


def test_messages_without_stamps_go_by_their_log_time(tmp_path: Path) -> None:
    builder = Builder(1)
    entries = []
    for i in range(3):
        time = START + i * SECOND // 30
        entries.append(Entry("/rgb", time, builder.image(colour(i), "rgb8", 0)))
        entries.append(Entry("/depth", time + 1000, builder.image(depth_mm(i), "16UC1", 0)))
    with open_recording(write_bag(tmp_path / "a.bag", "ros1", entries)) as recording:
        stamps = [frame.stamp_ns for frame in recording.frames()]
    assert stamps == [START + i * SECOND // 30 + 1000 for i in range(3)]


def _read_all(path: Path) -> None:
    with open_recording(path) as recording:
        for frame in recording.frames():
            frame.decode()


def _broken(folder: Path, kind: str, damage: str) -> Path:
    path = _camera_bag(folder, kind, 20)
    file = path if path.is_file() else next(path.glob(f"*.{'db3' if kind == 'sqlite3' else kind}"))
    data = file.read_bytes()
    cut = {
        "truncated": data[: len(data) // 2],
        "empty": b"",
        "wrong magic": b"something else" + data[14:],
        "holed": data[: len(data) // 2] + bytes(3000) + data[len(data) // 2 + 3000 :],
        "header only": data[:20],
    }
    file.write_bytes(cut[damage])
    return path


@pytest.mark.parametrize("damage", ["truncated", "empty", "wrong magic", "holed", "header only"])
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_recordings_give_one_line(tmp_path: Path, kind: str, damage: str) -> None:
    path = _broken(tmp_path, kind, damage)
    with pytest.raises(FileFormatError) as raised:
        _read_all(path)
    assert str(raised.value).startswith(str(path))
    assert "\n" not in str(raised.value)


def test_a_bag_without_an_index_says_how_to_repair_it(tmp_path: Path) -> None:
    """What `rosbag record` leaves when it is killed: index_pos is 0."""
    path = _camera_bag(tmp_path, "ros1")
    data = bytearray(path.read_bytes())
    place = data.index(b"index_pos=") + len(b"index_pos=")
    data[place : place + 8] = bytes(8)
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match="rosbag reindex"), open_recording(path):
        pass


@pytest.mark.parametrize(
    ("name", "reason"),
    [("no.bag", "no such file"), ("folder", "metadata.yaml"), ("a.txt", "unknown extension")],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.txt").write_text("text")
    with pytest.raises(FileFormatError, match=reason), open_recording(tmp_path / name):
        pass


def test_a_folder_whose_metadata_is_damaged_gives_one_line(tmp_path: Path) -> None:
    path = _camera_bag(tmp_path, "sqlite3")
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with pytest.raises(FileFormatError) as raised, open_recording(path):
        pass
    assert "\n" not in str(raised.value)
