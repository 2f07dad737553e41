"""steered-marigold bag: recordings of every kind in, the same with dense depth out."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from steered_marigold.cli import app
from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.io.bags import list_topics, open_recording
from steered_marigold.io.depth_maps import read_depth
from tests.io.bags.building import (
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
