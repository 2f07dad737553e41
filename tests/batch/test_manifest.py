"""What a folder run leaves beside its results, and what a resumed one makes of it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.batch.job import JobSettings, Plan, plan
from steered_marigold.batch.manifest import describe_model, describe_settings, threads_before
from steered_marigold.batch.run import complete_all
from steered_marigold.errors import CheckpointError, InputError
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.json_lines import JsonLines
from tests.batch.workers import load
from tests.frames.completers import NearestCompleter

MODEL = {"checkpoint": "embedded", "preset": "fast", "device": "cpu", "threads": 1}
Folders = tuple[Path, Path]


def _plan(folders: Folders, out: Path, *, overwrite: bool = False) -> Plan:
    source = folder_source(FrameFiles(image=folders[0], depth=folders[1]), Reading())
    return plan(source, Outputs(depth=out), suffix=".png", overwrite=overwrite)


def _how(folders: Folders, settings: JobSettings, reading: Reading | None = None) -> dict[str, Any]:
    inputs = FrameFiles(image=folders[0], depth=folders[1])
    return dict(describe_settings(inputs, reading or Reading(), settings, MODEL, ".png"))


def _run(
    folders: Folders,
    out: Path,
    settings: JobSettings,
    *,
    reading: Reading | None = None,
    overwrite: bool = False,
    workers: int = 1,
) -> list[str]:
    """The frames that were completed."""
    todo = _plan(folders, out, overwrite=overwrite)
    engine = LocalEngine(workers=workers, threads=1)
    how = _how(folders, settings, reading)
    outcomes = complete_all(load, todo, settings, how, engine=engine, overwrite=overwrite)
    return sorted(x.record.values["frame"] for x in outcomes if x.record is not None)


def test_a_record_a_frame_and_one_of_the_run(frame_folders: Folders, tmp_path: Path) -> None:
    images, depths = frame_folders
    (depths / "0001.png").write_bytes(b"no picture")
    _run(frame_folders, tmp_path / "out", JobSettings(seed=3))
    run = json.loads((tmp_path / "out/.run/run.json").read_text())
    assert run["settings"]["inputs"]["image"] == str(images.resolve())
    assert run["settings"]["completing"]["seed"] == 3
    assert run["settings"]["reading"]["depth_encoding"] == "z"
    assert run["paired_by"] == "equal stems"
    (session,) = run["sessions"]
    assert (session["engine"], session["frames"], session["skipped"]) == ("local", 3, 0)
    assert session["versions"]["torch"] == torch.__version__
    records = list(JsonLines(tmp_path / "out/.run/records.jsonl").read())
    assert [record.get("frame") for record in records] == ["0000", None, "0002"]
    assert records[0]["output"] == str(tmp_path / "out/0000.png")
    assert records[1]["image"] == str(images / "0001.png")
    assert "0001.png: damaged" in records[1]["error"]
    assert threads_before(tmp_path / "out") == 1
    assert threads_before(tmp_path) is None


def test_a_resumed_run_adds_to_the_record(frame_folders: Folders, tmp_path: Path) -> None:
    out, settings = tmp_path / "out", JobSettings()
    _run(frame_folders, out, settings)
    (out / "0001.png").unlink()
    with (out / ".run/records.jsonl").open("ab") as file:  # as if killed while writing
        file.write(b'{"frame": "00')
    assert _run(frame_folders, out, settings) == ["0001"]
    frames = [record["frame"] for record in JsonLines(out / ".run/records.jsonl").read()]
    assert frames == ["0000", "0001", "0002", "0001"]
    sessions = json.loads((out / ".run/run.json").read_text())["sessions"]
    assert [session["skipped"] for session in sessions] == [0, 2]


def test_other_settings_stop_a_resumed_run_and_are_named(
    frame_folders: Folders, tmp_path: Path
) -> None:
    out, settings = tmp_path / "out", JobSettings()
    _run(frame_folders, out, settings)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match=r"another `seed` \(0, now 1\); `overwrite` makes"):
        _run(frame_folders, out, replace(settings, seed=1))
    with pytest.raises(InputError, match=r"another `depth_scale` \(null, now 0.002\)"):
        _run(frame_folders, out, settings, reading=Reading(depth_scale=0.002))
    other = tmp_path / "other"
    frame_folders[0].rename(other)
    with pytest.raises(InputError, match="another `image`"):
        _run((other, frame_folders[1]), out, settings)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    other.rename(frame_folders[0])
    assert len(_run(frame_folders, out, replace(settings, seed=1), overwrite=True)) == 3
    assert len(list(JsonLines(out / ".run/records.jsonl").read())) == 3


def test_results_that_nobody_knows_stop_a_run(frame_folders: Folders, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "0001.png").write_text("mine")
    with pytest.raises(InputError, match=r"results of 1 frames, and no \.run/run\.json tells"):
        _run(frame_folders, tmp_path / "out", JobSettings())
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0001.png"]


def test_what_a_killed_run_left_is_removed(frame_folders: Folders, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    left = tmp_path / "out" / ".0001.0123abcd.tmp.png"
    mine = tmp_path / "out" / ".mine.png"
    left.touch()
    mine.touch()
    _run(frame_folders, tmp_path / "out", JobSettings())
    assert not left.exists()
    assert mine.exists()


def test_what_another_run_is_writing_is_left(frame_folders: Folders, tmp_path: Path) -> None:
    out = tmp_path / "out"
    how = _how(frame_folders, JobSettings())
    first = complete_all(load, _plan(frame_folders, out), JobSettings(), how)
    next(first)
    writing = out / ".0001.0123abcd.tmp.png"
    writing.touch()
    assert _run(frame_folders, out, JobSettings()) == ["0001", "0002"]
    assert writing.exists()
    assert len(list(first)) == 2


def test_a_run_that_cannot_begin_leaves_nothing(frame_folders: Folders, tmp_path: Path) -> None:
    def fail() -> NearestCompleter:
        raise CheckpointError("damaged")

    how = _how(frame_folders, JobSettings())
    with pytest.raises(CheckpointError, match="damaged"):
        list(complete_all(fail, _plan(frame_folders, tmp_path / "out"), JobSettings(), how))
    assert not (tmp_path / "out").exists()


def test_workers_write_the_bytes_of_one_process(frame_folders: Folders, tmp_path: Path) -> None:
    for name, workers in (("one", 1), ("two", 2)):
        _run(frame_folders, tmp_path / name, JobSettings(seed=2), workers=workers)
    for path in (tmp_path / "one").glob("*.png"):
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    assert len(list(JsonLines(tmp_path / "two/.run/records.jsonl").read())) == 3


def test_a_full_disk_ends_the_run(frame_folders: Folders, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "0001.png").symlink_to("/dev/full")
    todo = _plan(frame_folders, out, overwrite=True)
    how = _how(frame_folders, JobSettings())
    first, last = complete_all(load, todo, JobSettings(), how, overwrite=True)
    assert first.record is not None
    assert last.ends_run
    assert "No space left on device" in str(last.error)
    assert not (out / "0002.png").exists()


def test_a_model_is_known_by_its_checksum_and_what_its_defaults_are() -> None:
    told = describe_model({"checkpoint": "embedded", "preset": "paper", "device": "cpu"})
    assert (told["device"], told["dtype"], told["preset"]) == ("cpu", "float32", "paper")
    assert len(told["checkpoint_sha256"]) == 64
    assert "checkpoint" not in told
    with pytest.raises(InputError, match="unknown preset"):
        describe_model({"checkpoint": "embedded", "preset": "best"})
    with pytest.raises(CheckpointError, match="nowhere"):
        describe_model({"checkpoint": "nowhere", "preset": "fast", "device": "cpu"})


def test_lines_are_read_as_written_and_others_refused(tmp_path: Path) -> None:
    log = JsonLines(tmp_path / "log.jsonl")
    assert list(log.read()) == []
    log.append({"name": "a\nb\udcff", "value": None})
    log.append({"value": 1.5})
    assert list(log.read()) == [{"name": "a\nb\udcff", "value": None}, {"value": 1.5}]
    log.path.write_text("[1]\n")
    with pytest.raises(InputError, match="line 1 is no object"):
        list(log.read())
    with pytest.raises(InputError, match="cannot be written"):
        JsonLines(tmp_path / "none" / "log.jsonl").append({})
