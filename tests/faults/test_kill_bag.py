"""Copies of recordings that are killed leave no half of one, and the next run tidies up."""

import os
import signal
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from steered_marigold.frames.recordings import complete_recording
from steered_marigold.io.bags import list_topics, open_recording
from steered_marigold.methods.interpolation import NearestCompleter
from tests.faults.children import Child
from tests.io.bags.building import bag_path, builder_for, camera_entries, write_bag

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]

KILLS = 50 if "FAULTS" in os.environ else 3
FRAMES = 60


def _complete(path: Path, out: Path) -> None:
    """What `bag` does, with a method that takes no time to load."""
    with open_recording(path) as recording:
        _, tally = complete_recording(
            NearestCompleter(), recording, recording.frames(), out, overwrite=True
        )
    assert tally.completed == FRAMES


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "mcap_file"])
def test_a_killed_bag_is_whole_or_absent(tmp_path: Path, kind: str) -> None:
    path = bag_path(tmp_path, kind, "in")
    write_bag(path, kind, camera_entries(builder_for(kind), FRAMES))
    folder = tmp_path / "out"
    folder.mkdir()
    out = bag_path(folder, kind)
    started = perf_counter()
    _complete(path, out)
    seconds = perf_counter() - started
    whole = list_topics(out)
    assert whole[-1].count == FRAMES
    rng = np.random.default_rng(None if "FAULTS" in os.environ else 0)
    left = 0
    for number in range(KILLS):
        if number % 2 == 0 and out.exists():  # with an older output in the way, and without
            out.rename(tmp_path / f"before{number}")
        child = Child(lambda: _complete(path, out), tmp_path / "said")
        child.until(lambda: _hidden(folder, out))
        child.end(signal.SIGKILL, rng.uniform(0, 0.8) * seconds if number else 0)
        if out.exists():
            assert list_topics(out) == whole
        left += _hidden(folder, out)
    _complete(path, out)
    assert list_topics(out) == whole
    assert list(folder.iterdir()) == [out]
    assert left > 0  # the first at least did hit a run that was writing


def _hidden(folder: Path, out: Path) -> bool:
    """Whether a run is writing, or was."""
    return any(entry != out for entry in folder.iterdir())


def test_a_run_that_goes_on_is_left_alone(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "in", "mcap", camera_entries(builder_for("mcap"), FRAMES))
    out = tmp_path / "out"
    child = Child(lambda: _complete(path, out), tmp_path / "said")
    child.until(lambda: any(tmp_path.glob(".out.*/lock")))
    _complete(path, out)
    assert child.wait() == 0, child.said()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["in", "out", "said"]
