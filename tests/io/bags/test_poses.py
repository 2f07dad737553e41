"""The camera's poses from /tf, against motions that are known at every time."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.io.bags import RecordedFrame, open_recording
from steered_marigold.io.bags.poses import CameraPoses, interpolated
from tests.io.bags.building import (
    KINDS,
    SECOND,
    START,
    Builder,
    Entry,
    bag_path,
    builder_for,
    camera_entries,
    write_bag,
)

Matrix = NDArray[np.float64]
# x right, y down, z forward of the camera in x forward, y left, z up of the robot (REP 103)
OPTICAL = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 0.3], [0, 0, 0, 1]])
PERIOD = SECOND // 30
DEPTH_LATE = 4_000_000


def turned(angle: float, *at: float) -> Matrix:
    """About z, and moved."""
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[: len(at), 3] = at
    return matrix


def driven(stamp: int) -> Matrix:
    """base_link to odom: evenly forward and around, so that interpolation is exact."""
    seconds = (stamp - START) / SECOND
    return turned(0.8 * seconds, 0.5 * seconds, -0.2 * seconds)


def transform_entry(
    builder: Builder,
    stamp: int,
    *edges: tuple[str, str, Matrix],
    late: int = 20_000_000,
    topic: str = "/tf",
) -> Entry:
    """/tf of one stamp, written down a little later."""
    message = builder.transforms(*edges)
    for stamped in message.transforms:
        stamped.header = builder.header(stamp, stamped.header.frame_id)
    return Entry(topic, stamp + late, message)


def robot(builder: Builder, count: int = 12, *, rate: int = 50_000_000) -> list[Entry]:
    """A camera on a robot that is driven about: mounts are fixed, odometry comes at 20 Hz."""
    mounts = [("base_link", "/mast", turned(0, 0, 0, 0.5)), ("mast", "camera", OPTICAL)]
    entries = camera_entries(builder, count)
    entries.append(transform_entry(builder, START, *mounts, late=0, topic="/tf_static"))
    for stamp in range(START - rate, START + count * PERIOD + rate, rate):
        entries.append(transform_entry(builder, stamp, ("odom", "base_link", driven(stamp))))
    return entries


def read(path: Path, fixed_frame: str | None = None) -> tuple[list[RecordedFrame], CameraPoses]:
    with open_recording(path) as recording, recording.camera_poses(fixed_frame) as poses:
        return list(recording.frames(poses=poses)), poses


def expected(stamp: int) -> Matrix:
    matrix: Matrix = driven(stamp) @ turned(0, 0, 0, 0.5) @ OPTICAL
    return matrix


@pytest.mark.parametrize("kind", KINDS)
def test_poses_are_interpolated_at_the_stamp_of_depth(tmp_path: Path, kind: str) -> None:
    path = write_bag(bag_path(tmp_path, kind), kind, robot(builder_for(kind)))
    frames, poses = read(path)
    assert poses.fixed_frame == "odom"
    assert (poses.counts.found, poses.counts.missing, poses.counts.damaged) == (12, 0, 0)
    for frame in frames:
        assert frame.pose is not None
        assert np.allclose(frame.pose.numpy(), expected(frame.stamp_ns), atol=1e-9)
    pose = recorded_frame(frames[3]).pose
    assert pose is not None
    assert np.allclose(pose.numpy(), expected(frames[3].stamp_ns), atol=1e-9)


def test_frames_have_no_pose_that_is_not_asked_for(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", "mcap", robot(Builder(2)))
    with open_recording(path) as recording:
        assert all(frame.pose is None for frame in recording.frames())


def _slerp(first: NDArray[np.float64], second: NDArray[np.float64], share: float) -> Matrix:
    """K. Shoemake, "Animating rotation with quaternion curves", 1985, Eq. of section 3.3.

    Of unit quaternions w, x, y, z; as a rotation matrix.
    """
    second = second if first @ second >= 0 else -second
    theta = np.arccos(np.minimum(first @ second, 1.0))
    if theta < 1e-6:
        q = first
    else:
        q = np.sin((1 - share) * theta) * first + np.sin(share * theta) * second
    w, x, y, z = q / np.linalg.norm(q)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: Matrix = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return matrix


unit = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(unit, unit, st.floats(0, 1))
def test_rotations_are_interpolated_as_quaternions_are(
    first: list[float], second: list[float], share: float
) -> None:
    a, b = (np.array(q) / np.linalg.norm(q) for q in (first, second))
    if abs(a @ b) < 1e-3:
        return  # half a turn apart: either way around is right
    begin, end = np.eye(4), np.eye(4)
    begin[:3, :3], begin[:3, 3] = _slerp(a, a, 0), (0, 1, 2)
    end[:3, :3], end[:3, 3] = _slerp(b, b, 0), (4, 1, -2)
    between = interpolated(begin, end, share)
    assert np.allclose(between[:3, :3], _slerp(a, b, share), atol=1e-5)
    assert np.allclose(between[:3, 3], [4 * share, 1, 2 - 4 * share])
    assert np.allclose(between[3], [0, 0, 0, 1])


def _without_odometry(entries: list[Entry], begin: float, end: float) -> list[Entry]:
    """Without the /tf of a stretch of time [s]."""
    return [
        entry
        for entry in entries
        if entry.topic != "/tf" or not begin <= (entry.time - START) / SECOND < end
    ]


@pytest.mark.parametrize(
    ("begin", "end", "lacking"),
    [
        (0.6, 9.0, range(20, 60)),  # the last one is of 0.55 s and is held until 0.65 s
        (-1.0, 1.0, range(27)),  # the first one is of 1.0 s and is held from 0.9 s on
        (0.5, 0.9, range(0)),  # a gap that is bridged
        (0.5, 1.8, range(14, 54)),  # one that is not: 0.45 to 1.8 s
    ],
)
def test_no_pose_is_made_up(tmp_path: Path, begin: float, end: float, lacking: range) -> None:
    """Transforms are held for 0.1 s, and gaps of more than a second are not bridged."""
    entries = _without_odometry(robot(Builder(2), 60), begin, end)
    frames, poses = read(write_bag(tmp_path / "bag", "mcap", entries))
    without = [frame.index for frame in frames if frame.pose is None]
    around = 3 if len(lacking) else 0  # 0.1 s at either end
    assert set(without) <= set(lacking)
    assert set(list(lacking)[around : len(lacking) - around]) <= set(without)
    assert poses.counts.missing == len(without)


def test_fixed_mounts_alone_tell_no_motion(tmp_path: Path) -> None:
    """Old programs repeat fixed transforms on /tf; the robot may move all the same."""
    builder = Builder(1)
    entries = camera_entries(builder, 10)
    for i in range(10):
        still = ("base_link", "camera", OPTICAL)
        entries.append(transform_entry(builder, START + i * PERIOD, still))
    path = write_bag(tmp_path / "a.bag", "ros1", entries)
    assert all(frame.pose is None for frame in read(path)[0])
    frames, poses = read(path, "base_link")  # asked for: then it does stand still
    assert poses.counts.found == 10
    pose = frames[0].pose
    assert pose is not None
    assert np.allclose(pose.numpy(), OPTICAL)


def test_odom_wins_over_a_map_that_jumps(tmp_path: Path) -> None:
    builder = Builder(2)
    entries = robot(builder)
    for i in range(10):
        jump = ("map", "odom", turned(0, float(i > 5)))
        entries.append(transform_entry(builder, START + i * PERIOD, jump))
    path = write_bag(tmp_path / "bag", "mcap", entries)
    assert read(path)[1].fixed_frame == "odom"
    frames, poses = read(path, "map")
    assert poses.fixed_frame == "map"
    last = frames[9].pose
    assert last is not None
    assert np.allclose(last.numpy(), turned(0, 1.0) @ expected(frames[9].stamp_ns), atol=1e-9)


def test_poses_in_two_worlds_never_meet(tmp_path: Path) -> None:
    """Where a new root appears frames have no pose, for no longer than is looked ahead."""
    builder = Builder(2)
    entries = robot(builder, 60)
    for entry in entries:
        if entry.topic == "/tf":
            (stamped,) = entry.message.transforms
            stamped.header.frame_id = "start"
    for i in range(40, 60):
        above = ("world", "start", turned(0, 0, 7.0))
        entries.append(transform_entry(builder, START + i * PERIOD, above))
    frames, poses = read(write_bag(tmp_path / "bag", "mcap", entries))
    assert poses.fixed_frame == "world"
    lacking = [frame.index for frame in frames if frame.pose is None]
    assert lacking == list(range(lacking[0], lacking[-1] + 1))
    assert len(lacking) <= 15
    for frame in frames:
        if frame.pose is not None:
            up = 7.0 if frame.index > lacking[-1] else 0.0
            there = turned(0, 0, up) @ expected(frame.stamp_ns)
            assert np.allclose(frame.pose.numpy(), there, atol=1e-9)


def test_a_tree_that_hangs_from_the_camera(tmp_path: Path) -> None:
    """Some programs give the world in the camera: its name says what stands still."""
    builder = Builder(2)
    entries = camera_entries(builder, 12)
    for i in range(-2, 14):
        stamp = START + i * PERIOD + DEPTH_LATE
        inverse: Matrix = np.linalg.inv(driven(stamp)).astype(np.float64)
        entries.append(transform_entry(builder, stamp, ("camera", "world", inverse)))
    path = write_bag(tmp_path / "bag", "mcap", entries)
    assert all(frame.pose is None for frame in read(path)[0])
    frames, poses = read(path, "world")
    assert poses.counts.found == 12
    for frame in frames:
        assert frame.pose is not None
        assert np.allclose(frame.pose.numpy(), driven(frame.stamp_ns), atol=1e-9)


def test_a_damaged_transform_ends_nothing(tmp_path: Path) -> None:
    entries = robot(Builder(2))
    (broken, *_) = [entry for entry in entries if entry.topic == "/tf"][4:]
    broken.data = b"\x00\x01\x00\x00\xff"
    frames, poses = read(write_bag(tmp_path / "bag", "mcap", entries))
    assert poses.counts.damaged == 1
    assert all(
        frame.pose is not None
        and np.allclose(frame.pose.numpy(), expected(frame.stamp_ns), atol=1e-9)
        for frame in frames
    )


def test_only_the_last_seconds_are_kept(tmp_path: Path) -> None:
    """What is remembered of a minute at 20 Hz is ten seconds of it."""
    entries = [e for e in robot(Builder(2), 1800) if e.topic != "/camera/color/camera_info"]
    for entry in entries:
        if entry.topic.endswith("image_raw"):
            entry.message.data = entry.message.data[:1]  # never decoded
            entry.message.header.frame_id = "camera"
    _, poses = read(write_bag(tmp_path / "bag", "mcap", entries))
    assert poses.counts.found == 1800
    (kept,) = poses._window._recent.values()
    assert len(kept) <= 202
