"""Runs that are killed at random moments go on to the bytes of one that was not."""

import csv
import json
import os
import shutil
import signal
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.batch.job import JobSettings, plan
from steered_marigold.batch.run import complete_all
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.report import write_outputs
from steered_marigold.evaluation.runner import run_evaluation
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.json_lines import JsonLines
from tests.batch.workers import load
from tests.faults.children import Child
from tests.frames.completers import write_frame, write_frames

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]

KILLS = 50 if "FAULTS" in os.environ else 12
KILLED_EVALUATIONS = 50 if "FAULTS" in os.environ else 6
FRAMES = 12
HOW = {"completing": {"seed": 0}}


@pytest.fixture
def inputs(tmp_path: Path) -> FrameFiles:
    """Folders of frames."""
    return write_frames(tmp_path, map(str, range(FRAMES)))


def _run(inputs: FrameFiles, out: Path, workers: int = 1) -> None:
    """All outputs there are, into folders of their own."""
    folders = Outputs(depth=out / "depth", uncertainty=out / "sure")
    todo = plan(folder_source(inputs, Reading()), folders, suffix=".npy", overwrite=False)
    engine = LocalEngine(workers=workers, threads=1)
    assert all(x.record for x in complete_all(load, todo, JobSettings(), HOW, engine=engine))


def _contents(out: Path) -> dict[str, bytes]:
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.parent.name != ".run"
    }


def test_a_run_killed_again_and_again_ends_with_the_same_bytes(
    inputs: FrameFiles, tmp_path: Path
) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    _run(inputs, whole)
    rng = np.random.default_rng(None if "FAULTS" in os.environ else 0)
    for number in range(KILLS):
        child = Child(lambda: _run(inputs, killed), tmp_path / "said")
        child.end(signal.SIGKILL, rng.uniform(0, 0.05))
        done = sorted((killed / "depth").glob("*.npy")) if killed.exists() else []
        if len(done) == FRAMES:  # begin anew, there are more moments to try
            done[number % FRAMES].unlink()
    _run(inputs, killed)
    assert _contents(killed) == _contents(whole)
    frames = {record["frame"] for record in JsonLines(killed / "depth/.run/records.jsonl").read()}
    assert frames <= {str(index) for index in range(FRAMES)}


def test_an_evaluation_killed_again_and_again_ends_with_the_same_tables(tmp_path: Path) -> None:
    """Killed while it completes, while it writes tables and while it draws."""
    frames, whole, killed = (tmp_path / name for name in ("frames", "whole", "killed"))
    for name in ("rgb", "depth"):
        (frames / name).mkdir(parents=True)
    for index in range(4):
        write_frame(frames / f"rgb/{index}.png", frames / f"depth/{index}.png", seed=index)
    settings = RunSettings(
        dataset="folder",
        path=frames,
        protocol=Protocol(kind="lidar", lines=4),
        methods=("nearest", "linear", "fast"),
        frames=tuple(map(str, range(4))),
    )
    completers = {label: settings.method_factory()(label) for label in settings.methods}

    def run(out: Path) -> None:
        engine = LocalEngine(threads=1)
        write_outputs(
            run_evaluation(settings, out, create=completers.__getitem__, engine=engine), out
        )

    started = perf_counter()
    run(whole)
    span = perf_counter() - started
    rng = np.random.default_rng(None if "FAULTS" in os.environ else 0)
    for _ in range(KILLED_EVALUATIONS):
        child = Child(lambda: run(killed), tmp_path / "said")
        child.end(signal.SIGKILL, rng.uniform(0, 1.2 * span))
        if (killed / "report.html").exists():  # begin anew, there are more moments to try
            shutil.rmtree(killed)
    left = [killed / ".table.0a1b2c3d.tmp.md", killed / "predictions/fast/.3.0a1b2c3d.tmp.png"]
    for path in left:  # as a kill while they are written would
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    run(killed)
    assert _without_times(killed) == _without_times(whole)


def _without_times(out: Path) -> dict[str, object]:
    """All files of an evaluation; of those that tell times only the rest of their numbers."""
    files: dict[str, object] = dict(_contents(out))
    for name in ("report.html", "table.md", "table.tex", "run.json"):
        files[name] = name in files
    files["summary.json"] = [
        {key: value for key, value in row.items() if key != "seconds_per_image"}
        for row in json.loads((out / "summary.json").read_text())["rows"]
    ]
    for name in ("per_image.csv", "comparisons.csv"):
        with (out / name).open(newline="") as file:
            rows = list(csv.DictReader(file))
        files[name] = [{k: v for k, v in row.items() if k != "seconds"} for row in rows]
    lines = [{**line, "seconds": 0} for line in JsonLines(out / "results.jsonl").read()]
    files["results.jsonl"] = sorted(lines, key=lambda line: (line["method"], line["frame_id"]))
    return files


def test_two_runs_at_once_in_one_folder(inputs: FrameFiles, tmp_path: Path) -> None:
    whole, both = tmp_path / "whole", tmp_path / "both"
    _run(inputs, whole)
    children = [Child(lambda: _run(inputs, both), tmp_path / f"said{i}") for i in range(2)]
    for child in children:
        assert child.wait() == 0, child.said()
    assert _contents(both) == _contents(whole)


def test_a_run_whose_workers_lose_their_parent(inputs: FrameFiles, tmp_path: Path) -> None:
    """Workers end with it, and a resumed run is alone."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    _run(inputs, whole)
    child = Child(lambda: _run(inputs, killed, workers=2), tmp_path / "said")
    child.until(lambda: any((killed / "depth").glob("*.npy")))
    child.end(signal.SIGKILL, 0)
    _run(inputs, killed)
    assert _contents(killed) == _contents(whole)
