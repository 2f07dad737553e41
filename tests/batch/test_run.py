"""Folder runs, with a completer that needs no checkpoint."""

from pathlib import Path

import pytest
import torch
from PIL import Image

from steered_marigold.batch.job import JobSettings, Outcome, Plan, complete_to_files, plan
from steered_marigold.batch.run import complete_all
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source, read_frame
from steered_marigold.methods.completer import DepthCompleter
from tests.frames.completers import NearestCompleter

SETTINGS = JobSettings(seed=5)
HOW = {"completing": {"seed": 5}}
Folders = tuple[Path, Path]


def _plan(
    folders: Folders, out: Path, *, suffix: str = ".png", overwrite: bool = False, **more: Path
) -> Plan:
    source = folder_source(FrameFiles(image=folders[0], depth=folders[1]), Reading())
    return plan(source, Outputs(depth=out, **more), suffix=suffix, overwrite=overwrite)


def _run(
    completer: DepthCompleter, todo: Plan, *, overwrite: bool = False
) -> tuple[list[str], list[Outcome]]:
    """The names of the files that were written, and the outcomes that failed."""
    outcomes = list(complete_all(lambda: completer, todo, SETTINGS, HOW, overwrite=overwrite))
    done = [Path(x.record.values["output"]).name for x in outcomes if x.record is not None]
    return done, [x for x in outcomes if x.error is not None]


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_a_folder_run_gives_the_bytes_of_single_runs(
    completer: NearestCompleter, frame_folders: Folders, tmp_path: Path, suffix: str
) -> None:
    done, failed = _run(completer, _plan(frame_folders, tmp_path / "out", suffix=suffix))
    assert (done, failed) == ([f"{stem}{suffix}" for stem in ("0000", "0001", "0002")], [])
    for stem in ("0002", "0000"):
        files = FrameFiles(
            image=frame_folders[0] / f"{stem}.png", depth=frame_folders[1] / f"{stem}.png"
        )
        outputs = Outputs(depth=tmp_path / f"single{suffix}")
        record = complete_to_files(
            completer, read_frame(files, Reading()), files, outputs, SETTINGS
        )
        assert outputs.depth.read_bytes() == (tmp_path / f"out/{stem}{suffix}").read_bytes()
        assert record.values["output"] == str(outputs.depth)
        assert (record.values["image"], record.values["depth"]) == (
            str(files.image),
            str(files.depth),
        )
        assert record.values["seed"] == 5


def test_results_are_kept_unless_they_shall_be_overwritten(
    completer: NearestCompleter, frame_folders: Folders, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    _run(completer, _plan(frame_folders, out))
    (out / "0001.png").unlink()
    (out / "0002.png").write_text("mine")
    todo = _plan(frame_folders, out)
    assert todo.skipped == 2
    assert _run(completer, todo) == (["0001.png"], [])
    assert (out / "0002.png").read_text() == "mine"
    todo = _plan(frame_folders, out, overwrite=True)
    assert (len(_run(completer, todo, overwrite=True)[0]), todo.skipped) == (3, 0)


def test_a_result_is_missing_while_any_of_its_files_is(
    completer: NearestCompleter, frame_folders: Folders, tmp_path: Path
) -> None:
    _run(completer, _plan(frame_folders, tmp_path / "out"))
    todo = _plan(frame_folders, tmp_path / "out", uncertainty=tmp_path / "sure")
    assert (len(todo.frames), todo.skipped) == (3, 0)


def test_bad_frames_are_named_and_counted_and_the_others_done(
    completer: NearestCompleter, frame_folders: Folders, tmp_path: Path
) -> None:
    images, depths = frame_folders
    (depths / "0000.png").write_bytes((depths / "0000.png").read_bytes()[:60])
    Image.new("RGB", (16, 24)).save(images / "0002.png")  # of another size
    Image.new("RGB", (32, 24)).save(images / "0003.png")  # without depth
    Image.new("I;16", (32, 24)).save(depths / "0004.png")  # without an image
    (images / ".hidden.png").write_text("x")
    (images / "notes.txt").write_text("x")
    todo = _plan(frame_folders, tmp_path / "out")
    assert todo.source.lone == (depths / "0004.png", images / "0003.png")
    done, failed = _run(completer, todo)
    assert done == ["0001.png"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [".run", "0001.png"]
    assert [outcome.frame for outcome in failed] == [
        str(images / "0000.png"),
        str(images / "0002.png"),
    ]
    for outcome, problem in zip(failed, ("0000.png: damaged", "16x24"), strict=True):
        assert outcome.error is not None
        assert problem in outcome.error


def test_a_completer_that_breaks_on_a_frame_does_not_end_the_run(
    frame_folders: Folders, tmp_path: Path
) -> None:
    class Fragile(NearestCompleter):
        def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
            if frame.id == "0001":
                raise RuntimeError("out of memory")
            return super()._complete(frame, generator)

    done, failed = _run(Fragile(), _plan(frame_folders, tmp_path / "out"))
    assert done == ["0000.png", "0002.png"]
    assert failed == [
        Outcome(frame=str(frame_folders[0] / "0001.png"), error="RuntimeError('out of memory')")
    ]


def test_folders_that_make_no_run(
    completer: NearestCompleter, frame_folders: Folders, tmp_path: Path
) -> None:
    for folder in frame_folders:
        with pytest.raises(InputError, match="holds inputs; results need a folder of their own"):
            _plan(frame_folders, folder)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot be a folder"):
        _run(completer, _plan(frame_folders, tmp_path / "file"))


@pytest.mark.parametrize("bound", [0.0, -0.1, float("nan"), float("inf")])
def test_a_bound_that_cannot_be_meant_is_refused_at_once(bound: float) -> None:
    with pytest.raises(InputError, match="`max_uncertainty` must be a positive number"):
        JobSettings(max_uncertainty=bound)
