"""steered-marigold bag: recordings of every kind in, the same with dense depth out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from typer.testing import CliRunner

from steered_marigold.cli import app
from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.io.bags import list_topics, open_recording
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.methods.streaming import StreamingCompleter
from tests.io.bags.building import (
    SECOND,
    START,
    Entry,
    bag_path,
    builder_for,
    camera_entries,
    realsense_entries,
    write_bag,
)

DEPTH = "/camera/depth/image_raw"


def run(*words: object) -> str:
    result = CliRunner().invoke(app, ["bag", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return str(result.output)


def smooth_entries(kind: str, count: int = 3) -> list[Entry]:
    """A registered camera before a slanted wall with a hole."""
    builder = builder_for(kind)
    entries = camera_entries(builder, count=count)
    depth = np.tile(np.linspace(1500, 1700, 8).astype(np.uint16), (6, 1))
    depth[2:4, 3:5] = 0
    for entry in entries:
        if entry.topic == DEPTH:
            entry.message.data = depth.view(np.uint8).reshape(-1)
    return entries


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Three frames of a registered camera, in every storage."""
    folder = tmp_path_factory.mktemp("recordings")
    kinds = ("ros1", "sqlite3", "mcap")
    entries = {kind: smooth_entries(kind) for kind in kinds}
    return {k: write_bag(bag_path(folder, k, k), k, entries[k]) for k in kinds}


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_dense_depth_is_added(recordings: dict[str, Path], tmp_path: Path, kind: str) -> None:
    out = bag_path(tmp_path, kind, "out")
    said = run(recordings[kind], "-o", out, "--uncertainty")
    assert "3 completed, 0 failed" in said
    counts = {topic.name: topic.count for topic in list_topics(out)}
    assert counts[f"{DEPTH}/completed"] == counts[f"{DEPTH}/completed/uncertainty"] == 3
    assert counts[DEPTH] == 3
    with (
        open_recording(recordings[kind]) as before,
        open_recording(out, depth_topic=f"{DEPTH}/completed") as after,
    ):
        for given, answer in zip(before.frames(), after.frames(), strict=True):
            sparse, dense = recorded_frame(given), recorded_frame(answer)
            assert answer.stamp_ns == given.stamp_ns
            assert bool(dense.valid_mask.all())
            kept = (dense.sparse_depth - sparse.sparse_depth).abs()[sparse.valid_mask]
            assert float((kept < 1e-3).float().mean()) > 0.9


def test_frames_as_files(recordings: dict[str, Path], tmp_path: Path) -> None:
    said = run(recordings["mcap"], "-o", f"{tmp_path}/files/", "--every", "2")
    assert "2 completed, 0 failed" in said
    names = {p.parent.name for p in tmp_path.rglob("*.png")}
    assert names == {"image", "depth", "uncertainty"}
    for path in (tmp_path / "files" / "depth").iterdir():
        assert bool(read_depth(path).valid_mask.all())


def test_the_unregistered_depth_of_a_realsense_is_registered(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "in.bag", "ros1", realsense_entries(builder_for("ros1"), count=2))
    run(path, "-o", tmp_path / "out.bag", "--rerun", tmp_path / "out.rrd")
    assert (tmp_path / "out.rrd").stat().st_size > 0
    (added,) = [t for t in list_topics(tmp_path / "out.bag") if "completed" in t.name]
    assert added.count == 2


def test_a_damaged_message_is_counted_and_ends_nothing(tmp_path: Path) -> None:
    builder = builder_for("mcap")
    entries = camera_entries(builder, count=3)
    broken = [entry for entry in entries if entry.topic == DEPTH][1]
    pixels = np.asarray(broken.message.data)[:4]
    broken.message.data = pixels
    path = write_bag(bag_path(tmp_path, "mcap"), "mcap", entries)
    result = CliRunner().invoke(app, ["bag", str(path), "-o", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "2 completed, 1 failed" in result.output
    assert "Traceback" not in result.output


def test_topics_that_must_be_named_are_listed(tmp_path: Path) -> None:
    builder = builder_for("ros1")
    entries = camera_entries(builder, count=1)
    more = [Entry(e.topic.replace("/camera", "/other"), e.time, e.message) for e in entries]
    path = write_bag(tmp_path / "in.bag", "ros1", [*entries, *more])
    result = CliRunner().invoke(app, ["bag", str(path), "-o", str(tmp_path / "out.bag")])
    assert result.exit_code == 2
    assert "--depth-topic" in result.output
    assert "/other/depth/image_raw" in result.output
    assert not (tmp_path / "out.bag").exists()


def _moving_camera(kind: str, poses: list[NDArray[np.float64]]) -> list[Entry]:
    """A slanted wall seen by a camera that odometry follows; holes where they were seen before."""
    builder = builder_for(kind)
    entries = smooth_entries(kind, len(poses))
    for index, pose in enumerate(poses):
        stamp = START + index * (SECOND // 30) + 4_000_000
        moved = builder.transforms(("odom", "base_link", pose @ np.linalg.inv(MOUNT)))
        moved.transforms[0].header = builder.header(stamp, "odom")
        entries.append(Entry("/tf", stamp + 9_000_000, moved))
    mount = builder.transforms(("base_link", "camera", MOUNT))
    return [*entries, Entry("/tf_static", START, mount)]


MOUNT = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0.3], [0, 0, 0, 1]])


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_stream_with_poses_from_tf_is_that_of_the_poses(tmp_path: Path, kind: str) -> None:
    """As when the same poses come with the frames."""
    poses = []
    for i in range(4):
        poses.append(np.eye(4))
        poses[-1][:3, 3] = 0.02 * i, -0.01 * i, 0.03 * i
    path = write_bag(bag_path(tmp_path, kind, "in"), kind, _moving_camera(kind, poses))
    said = run(path, "-o", bag_path(tmp_path, kind, "out"), "--stream")
    assert "motion: 3 times from /tf (camera in odom), 0 by odometry, 0 by optical flow" in said
    stream = StreamingCompleter.from_checkpoint(preset="fast", device="cpu")
    with (
        open_recording(path) as before,
        open_recording(
            bag_path(tmp_path, kind, "out"), depth_topic=f"{DEPTH}/completed"
        ) as completed,
    ):
        for given, answer, pose in zip(before.frames(), completed.frames(), poses, strict=True):
            frame = replace(recorded_frame(given), pose=torch.from_numpy(pose))
            depth = stream.answer(frame).depth[0]
            assert torch.equal(answer.decode().depth, (depth * 1000).round() / 1000)
    assert stream.motions == {"pose": 3}


def test_tf_is_left_aside_if_that_is_asked_for(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "in", "mcap", _moving_camera("mcap", [np.eye(4)] * 2))
    said = run(path, "-o", tmp_path / "out", "--stream", "--fixed-frame", "none")
    assert "motion: 0 times from /tf, " in said
    said = run(path, "-o", tmp_path / "other", "--stream", "--fixed-frame", "moon")
    assert "/tf never joins camera to --fixed-frame moon" in said
    result = CliRunner().invoke(app, ["bag", str(path), "-o", "x", "--fixed-frame", "odom"])
    assert result.exit_code == 2
    assert "--fixed-frame is of --stream" in result.output
