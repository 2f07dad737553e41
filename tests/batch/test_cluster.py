"""Frames on a Ray cluster: the bytes of a run without, whoever is killed on the way."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep

import pytest

from steered_marigold.batch.engines import Engine, LocalEngine
from steered_marigold.batch.job import JobSettings, plan
from steered_marigold.batch.run import complete_all
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.json_lines import JsonLines
from tests.batch.workers import LoadsOneToBeKilled, load
from tests.frames.completers import write_frames

pytest.importorskip("ray")
pytestmark = [
    pytest.mark.slow,  # Ray needs 10 s to start
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of Ray's own settings
]

FRAMES = 48
HOW = {"completing": {"seed": 0}}


@pytest.fixture
def inputs(tmp_path: Path) -> FrameFiles:
    """Folders of frames."""
    return write_frames(tmp_path, (f"{index:02d}" for index in range(FRAMES)))


@pytest.fixture
def cluster() -> Iterator[str]:
    """Its address. CPUs are a number that one gives, so there is room for two actors anywhere."""
    from ray.cluster_utils import Cluster

    begun = Cluster(initialize_head=True, head_node_args={"num_cpus": 3})
    yield begun.address
    begun.shutdown()  # type: ignore[no-untyped-call]


def test_two_actors_one_of_them_killed(inputs: FrameFiles, cluster: str, tmp_path: Path) -> None:
    """Its block is done again; every frame has its record."""
    from steered_marigold.batch.cluster import RayEngine

    def run(engine: Engine, out: Path, mark: Path | None) -> None:
        todo = plan(
            folder_source(inputs, Reading()), Outputs(depth=out), suffix=".png", overwrite=False
        )
        start = load if mark is None else LoadsOneToBeKilled(f"{FRAMES // 2}", mark)
        outcomes = complete_all(start, todo, JobSettings(), HOW, engine=engine)
        assert all(outcome.record for outcome in outcomes)

    run(LocalEngine(threads=1), tmp_path / "whole", None)
    run(RayEngine(address=cluster, actors=2), tmp_path / "killed", tmp_path / "mark")
    assert (tmp_path / "mark").exists()
    assert _contents(tmp_path / "killed") == _contents(tmp_path / "whole")
    records = JsonLines(tmp_path / "killed/.run/records.jsonl").read()
    assert sorted(x["frame"] for x in records) == [f"{index:02d}" for index in range(FRAMES)]


def test_the_command_with_its_driver_killed(inputs: FrameFiles, tmp_path: Path) -> None:
    """As a user runs and resumes it, with the packaged model."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(_command(inputs, whole), check=True, capture_output=True)
    on_ray = [*_command(inputs, killed), "--engine", "ray", "--actors", "1"]
    with subprocess.Popen(on_ray, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as driver:
        deadline = monotonic() + 300
        while len(list(killed.glob("*.png"))) < 3:
            assert driver.poll() is None, driver.stderr and driver.stderr.read()
            assert monotonic() < deadline
            sleep(0.01)
        os.kill(driver.pid, signal.SIGKILL)
    resumed = subprocess.run(on_ray, capture_output=True, text=True, check=False)
    assert resumed.returncode == 0, resumed.stderr
    assert f"{FRAMES} frames, paired by equal stems" in resumed.stderr
    assert ", 0 failed" in resumed.stderr
    assert " 0 skipped" not in resumed.stderr
    assert _contents(killed) == _contents(whole)


def _command(inputs: FrameFiles, out: Path) -> list[str]:
    given = [str(path) for path in (*inputs.given(), "-o", out)]
    command = [sys.executable, "-m", "steered_marigold", "complete", *given]
    return [*command, "--preset", "fast", "--threads", "1"]


def _contents(out: Path) -> dict[str, bytes]:
    """Of the results, and of what a kill may have left."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
