"""Runs from and to object storage: fsspec's memory, its local files across processes, and S3."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fsspec.implementations.memory import MemoryFileSystem

from steered_marigold.batch import remote_records
from steered_marigold.batch.engines import LocalEngine
from steered_marigold.batch.job import JobSettings, Outcome, plan
from steered_marigold.batch.manifest import describe_settings, threads_before
from steered_marigold.batch.run import complete_all
from steered_marigold.errors import CheckpointError, InputError, SteeredMarigoldError
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.remote import location
from tests.batch.workers import load
from tests.frames.completers import NearestCompleter

Folders = tuple[Path, Path]


def _run(
    root: Path,
    out: Path,
    *,
    settings: JobSettings | None = None,
    workers: int = 1,
    overwrite: bool = False,
    load: Callable[[], NearestCompleter] = load,
    met: Callable[[Outcome], None] = lambda outcome: None,
    **more: Path,
) -> list[Outcome]:
    """What became of the frames in root/images and root/depths."""
    settings = settings or JobSettings()
    inputs = FrameFiles(image=root / "images", depth=root / "depths")
    source = folder_source(inputs, Reading())
    todo = plan(source, Outputs(depth=out, **more), suffix=".png", overwrite=overwrite)
    how = describe_settings(inputs, Reading(), settings, {"threads": 1}, ".png")
    engine = LocalEngine(workers=workers, threads=1)
    outcomes = []
    for outcome in complete_all(load, todo, settings, how, engine=engine, overwrite=overwrite):
        met(outcome)
        outcomes.append(outcome)
    return outcomes


def _upload(folder: Path, to: Path) -> None:
    for path in folder.iterdir():
        (to / path.name).write_bytes(path.read_bytes())


def _records(out: Path) -> list[dict[str, Any]]:
    """In the order of the objects' names."""
    objects = sorted(path for path in (out / ".run").iterdir() if path.name != "run.json")
    return [json.loads(line) for path in objects for line in path.read_text().splitlines()]


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def bucket(frame_folders: Folders) -> Iterator[Path]:
    """Three frames in a store in memory."""
    MemoryFileSystem.store.clear()
    for folder in frame_folders:
        _upload(folder, location("memory://bucket") / folder.name)
    yield location("memory://bucket")
    MemoryFileSystem.store.clear()


def test_a_bucket_gets_the_bytes_of_a_folder(
    bucket: Path, frame_folders: Folders, tmp_path: Path
) -> None:
    local = _run(tmp_path, tmp_path / "out", uncertainty=tmp_path / "sure")
    remote = _run(bucket, bucket / "out", uncertainty=bucket / "sure")
    assert [outcome.error for outcome in (*local, *remote)] == [None] * 6
    assert _names(bucket / "out") == [".run", "0000.png", "0001.png", "0002.png"]
    for folder in ("out", "sure"):
        for name in ("0000.png", "0001.png", "0002.png"):
            assert (bucket / folder / name).read_bytes() == (tmp_path / folder / name).read_bytes()
    first, *_ = records = _records(bucket / "out")
    assert len(records) == 3
    assert first["image"] == "memory://bucket/images/0000.png"
    assert first["output"] == "memory://bucket/out/0000.png"
    run = json.loads((bucket / "out/.run/run.json").read_text())
    assert run["settings"]["inputs"]["depth"] == "memory://bucket/depths"
    assert threads_before(bucket / "out") == 1


def test_a_resumed_run_does_what_is_left_and_adds_to_the_record(bucket: Path) -> None:
    out = bucket / "out"
    _run(bucket, out)
    (out / "0001.png").unlink()
    (again,) = _run(bucket, out)
    assert again.frame == "memory://bucket/images/0001.png"
    assert sorted(record["frame"] for record in _records(out)) == ["0000", "0001", "0001", "0002"]
    sessions = json.loads((out / ".run/run.json").read_text())["sessions"]
    assert [session["skipped"] for session in sessions] == [0, 2]
    with pytest.raises(InputError, match=r"memory://bucket/out: .* another `seed` \(0, now 1\)"):
        _run(bucket, out, settings=JobSettings(seed=1))
    assert len(_run(bucket, out, settings=JobSettings(seed=1), overwrite=True)) == 3
    assert len(_records(out)) == 3


def test_results_and_inputs_of_others_stop_a_run(bucket: Path) -> None:
    (bucket / "out/0001.png").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"no \.run/run\.json tells"):
        _run(bucket, bucket / "out")
    with pytest.raises(InputError, match="holds inputs"):
        _run(bucket, bucket / "images")
    with pytest.raises(InputError, match="must be one too"):
        _run(location("memory://nobucket"), bucket / "other")
    assert _names(bucket / "out") == ["0001.png"]


def test_bad_and_vanishing_objects_are_named_and_the_others_done(bucket: Path) -> None:
    (bucket / "images/0000.png").write_bytes(b"no picture")

    def vanish(outcome: Outcome) -> None:
        (bucket / "depths/0001.png").unlink(missing_ok=True)

    bad, gone, good = _run(bucket, bucket / "out", met=vanish)
    assert bad.error is not None
    assert bad.error.startswith("memory://bucket/images/0000.png: damaged")
    assert gone.error == "memory://bucket/depths/0001.png: no such object"
    assert good.record is not None
    assert _names(bucket / "out") == [".run", "0002.png"]
    assert [record.get("error") for record in _records(bucket / "out")] == [
        *(bad.error, gone.error, None)
    ]


def test_records_are_put_every_period(bucket: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote_records, "PERIOD_S", 0.0)
    seen: list[int] = []
    _run(bucket, bucket / "out", met=lambda _: seen.append(len(_records(bucket / "out"))))
    assert seen == [1, 2, 3]


def test_a_run_that_cannot_begin_leaves_nothing(bucket: Path) -> None:
    def fail() -> NearestCompleter:
        raise CheckpointError("damaged")

    with pytest.raises(CheckpointError, match="damaged"):
        _run(bucket, bucket / "out", load=fail)
    assert not (bucket / "out").exists()


def test_workers_share_a_store(
    frame_folders: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """fsspec's local files, which other processes see, too; they have folders."""
    monkeypatch.chdir(tmp_path)
    for name in ("one/.run", "two/.run"):
        (tmp_path / name).mkdir(parents=True)
    root = location("local://images").parent
    for name, workers in (("one", 1), ("two", 2)):
        outcomes = _run(root, root / name, workers=workers)
        assert [outcome.error for outcome in outcomes] == [None] * 3
    for path in (tmp_path / "one").glob("*.png"):
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    assert len(_records(tmp_path / "two")) == 3


def test_a_store_that_is_gone_ends_the_run(
    frame_folders: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out/.run").mkdir(parents=True)
    root = location("local://images").parent
    outcomes: list[Outcome] = []

    def lose(outcome: Outcome) -> None:
        outcomes.append(outcome)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)

    with pytest.raises(SteeredMarigoldError, match="the records of 1 frames are lost"):
        _run(root, root / "out", met=lose)
    done, last = outcomes
    assert done.record is not None
    assert last.ends_run
    assert "local://out/0001.png: cannot be written" in str(last.error)
