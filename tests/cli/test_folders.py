"""Folder runs, with a completer that needs no checkpoint."""

from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from steered_marigold.cli.folders import complete_folders, plan_folders
from steered_marigold.cli.frames import Completer, complete_frame, read_frame
from steered_marigold.cli.settings import Inputs, Outputs, Settings

from steered_marigold.errors import InputError

SETTINGS = Settings(seed=5)


def _run(
    completer: Completer,
    folders: tuple[Path, Path],
    out: Path,
    *,
    suffix: str = ".png",
    overwrite: bool = False,
) -> tuple[list[dict[str, Any]], int, int]:
    """Records, skipped, failed."""
    inputs = Inputs(image=folders[0], depth=folders[1])
    plan = plan_folders(inputs, Outputs(depth=out), SETTINGS, suffix=suffix, overwrite=overwrite)
    records: list[dict[str, Any]] = []
    failed = complete_folders(completer, plan.frames, SETTINGS, report=records.append)
    return records, plan.skipped, plan.failed + failed


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_a_folder_run_gives_the_bytes_of_single_runs(
    completer: Completer, frame_folders: tuple[Path, Path], tmp_path: Path, suffix: str
) -> None:
    records, _, failed = _run(completer, frame_folders, tmp_path / "out", suffix=suffix)
    assert ([Path(record["output"]).stem for record in records], failed) == (
        ["0000", "0001", "0002"],
        0,
    )
    for stem in ("0002", "0000"):
        inputs = Inputs(
            image=frame_folders[0] / f"{stem}.png", depth=frame_folders[1] / f"{stem}.png"
        )
        outputs = Outputs(depth=tmp_path / f"single{suffix}")
        complete_frame(completer, read_frame(inputs, SETTINGS), inputs, outputs, SETTINGS)
        assert outputs.depth.read_bytes() == (tmp_path / f"out/{stem}{suffix}").read_bytes()


def test_results_are_kept_unless_they_shall_be_overwritten(
    completer: Completer, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    _run(completer, frame_folders, tmp_path / "out")
    (tmp_path / "out" / "0001.png").unlink()
    (tmp_path / "out" / "0002.png").write_text("mine")
    records, skipped, failed = _run(completer, frame_folders, tmp_path / "out")
    assert ([Path(record["output"]).stem for record in records], skipped, failed) == (
        ["0001"],
        2,
        0,
    )
    assert (tmp_path / "out" / "0002.png").read_text() == "mine"
    records, skipped, _ = _run(completer, frame_folders, tmp_path / "out", overwrite=True)
    assert (len(records), skipped) == (3, 0)


def test_a_result_is_missing_while_any_of_its_files_is(
    completer: Completer, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    _run(completer, frame_folders, tmp_path / "out")
    inputs = Inputs(image=frame_folders[0], depth=frame_folders[1])
    outputs = Outputs(depth=tmp_path / "out", uncertainty=tmp_path / "sure")
    plan = plan_folders(inputs, outputs, SETTINGS, suffix=".png", overwrite=False)
    assert (len(plan.frames), plan.skipped) == (3, 0)


def test_bad_frames_are_named_and_counted_and_the_others_done(
    completer: Completer,
    frame_folders: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    images, depths = frame_folders
    (depths / "0000.png").write_bytes((depths / "0000.png").read_bytes()[:60])
    Image.new("RGB", (32, 24)).save(images / "0003.png")  # without depth
    Image.new("I;16", (32, 24)).save(depths / "0004.png")  # without an image
    Image.new("RGB", (32, 24)).save(images / "0002.jpg")  # a second 0002
    (images / ".hidden.png").write_text("x")
    (images / "notes.txt").write_text("x")
    records, _, failed = _run(completer, frame_folders, tmp_path / "out")
    assert ([Path(record["output"]).name for record in records], failed) == (["0001.png"], 4)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0001.png"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert all(line.startswith("error: ") for line in lines)
    for problem in ("0000.png: damaged", "0002.*: exactly one", "depths/0003.*", "images/0004.*"):
        assert any(problem in line for line in lines)


def test_a_completer_that_breaks_on_a_frame_does_not_end_the_run(
    completer: Completer,
    frame_folders: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Fragile(type(completer)):  # type: ignore[misc]
        def complete(self, image: Any, sparse_depth: Any, *args: Any, **kwargs: Any) -> Any:
            if abs(float(sparse_depth.sum()) - broken) < 1e-3:
                raise RuntimeError("out of memory")
            return super().complete(image, sparse_depth, *args, **kwargs)

    images, depths = frame_folders
    frame = read_frame(Inputs(image=images / "0001.png", depth=depths / "0001.png"), SETTINGS)
    broken = float(frame.depth.sum())
    records, _, failed = _run(Fragile(), frame_folders, tmp_path / "out")
    assert (len(records), failed) == (2, 1)
    assert "0001.png: RuntimeError('out of memory')" in capsys.readouterr().err


def test_folders_that_make_no_run(
    completer: Completer, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    images, depths = frame_folders
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no files with equal stems"):
        _run(completer, (images, tmp_path / "empty"), tmp_path / "out")
    with pytest.raises(InputError, match="must be one too"):
        _run(completer, (images, depths / "0000.png"), tmp_path / "out")
    with pytest.raises(InputError, match="unknown extension"):
        _run(completer, frame_folders, tmp_path / "out", suffix=".bmp")
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="is an input"):
        _run(completer, frame_folders, depths)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot be a folder"):
        _run(completer, frame_folders, tmp_path / "file")
