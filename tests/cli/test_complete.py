"""The whole command, files to files; a completer that needs no checkpoint stands for the model."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from examples import demo
from steered_marigold.cli import app, complete
from steered_marigold.errors import CheckpointError, MissingExtraError, SteeredMarigoldError
from tests.frames.completers import NearestCompleter

KEYS = {
    *("output", "preset", "steps", "seed", "seconds", "load_seconds", "input_valid_fraction"),
    *("scale", "shift", "depth_min_m", "depth_max_m", "metric", "device", "dtype", "checkpoint"),
    *("trusted", "untrusted", "floored", "unrepresentable", "treated_as_missing"),
    *(
        "image",
        "depth",
        "frame",
        "method",
        "steers",
        "notices",
        "points",
        "not_positive",
        "too_uncertain",
    ),
}
PAIRED = "3 frames, paired by equal stems\n"
Run = Callable[..., Result]


@pytest.fixture
def run(completer: NearestCompleter, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `complete` with these arguments."""
    monkeypatch.setattr(complete, "_load", lambda model, progress=False: completer)

    def invoke(*arguments: object) -> Result:
        return CliRunner().invoke(app, ["complete", *map(str, arguments)])

    return invoke


def test_the_record_is_all_that_is_on_stdout(
    run: Run, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    result = run(*frame_files, "-o", tmp_path / "out.exr", "--seed", 4, "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    record = json.loads(result.stdout)
    assert record.keys() >= KEYS
    assert record["seed"] == 4
    assert record["load_seconds"] >= 0
    assert record["treated_as_missing"].keys() == {
        *("zero", "negative", "non_finite", "saturated", "beyond_max_depth", "beyond_limits"),
        *("repeated", "absurd"),
    }


def test_paths_are_told_to_people(
    run: Run,
    frame_files: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*frame_files, "--visualization", "panels.png")
    lines = result.stdout.splitlines()
    assert lines[:2] == ["output: image_completed.png", "visualization: panels.png"]
    assert "% measured" in lines[2]
    assert Path("image_completed.png").exists()


def test_a_folder_gives_a_record_a_line_and_the_bytes_of_single_runs(
    run: Run, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    images, depths = frame_folders
    out = tmp_path / "out"
    result = run(images, depths, "-o", out, "--output-format", "npy", "--json")
    assert result.exit_code == 0
    assert re.fullmatch(f"{PAIRED}3 completed, 0 skipped, 0 failed, .* frames/s\n", result.stderr)
    records = [json.loads(line) for line in result.stdout.splitlines()]
    assert [Path(record["output"]).name for record in records] == [
        *("0000.npy", "0001.npy", "0002.npy")
    ]
    run(images / "0001.png", depths / "0001.png", "-o", tmp_path / "single.npy")
    assert (out / "0001.npy").read_bytes() == (tmp_path / "single.npy").read_bytes()
    again = run(images, depths, "-o", out, "--output-format", "npy", "--json")
    assert (again.stdout, again.stderr) == (
        "",
        f"{PAIRED}0 completed, 3 skipped, 0 failed\n",
    )


def test_a_failed_frame_shows_in_the_exit_code(
    run: Run, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    images, depths = frame_folders
    (images / "0001.png").write_text("no image")
    (depths / "0002.png").unlink()
    result = run(images, depths, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert "1 completed, 0 skipped, 2 failed" in result.stderr
    assert f"error: {images / '0001.png'}: " in result.stderr
    assert f"error: {images / '0002.png'}: belongs to no pair" in result.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [".run", "0000.png"]


def test_other_settings_than_those_of_the_results_stop_a_run(
    run: Run, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    assert run(*frame_folders, "-o", tmp_path / "out").exit_code == 0
    result = run(*frame_folders, "-o", tmp_path / "out", "--depth-scale", "0.002", "--steps", "3")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "another --depth-scale (null, now 0.002), --steps (null, now 3); --overwrite makes" in (
        result.stderr
    )
    again = run(*frame_folders, "-o", tmp_path / "out", "--depth-scale", "0.002", "--overwrite")
    assert again.exit_code == 0


def test_options_of_another_engine_are_refused(
    run: Run, frame_folders: tuple[Path, Path], tmp_path: Path
) -> None:
    result = run(*frame_folders, "-o", tmp_path / "out", "--actors", "2")
    assert result.exit_code == 2
    assert "--actors is of --engine ray" in result.stderr
    result = run(*frame_folders, "-o", tmp_path / "out", "--engine", "ray", "--workers", "2")
    assert result.exit_code == 2
    assert "--workers is of --engine local" in result.stderr
    assert not (tmp_path / "out").exists()


def test_relative_depth_of_an_image_alone(
    run: Run, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out.png"
    result = run(frame_files[0], "--no-measurements", "-o", out, "--json")
    record = json.loads(result.stdout)
    assert (record["metric"], record["depth"]) == (False, None)
    assert not any(record["treated_as_missing"].values())
    assert np.asarray(Image.open(out)).max() > 40_000


def test_doubts_are_warnings_in_the_words_of_the_command(
    run: Run, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out.npy"
    result = run(*frame_files, "--depth-scale", 1, "-o", out, "--json")
    assert result.exit_code == 0
    notices = json.loads(result.stdout)["notices"]
    assert "implausible_scale" in {notice["kind"] for notice in notices}
    lines = result.stderr.splitlines()
    assert len(lines) == len(notices)
    assert all(line.startswith(f"warning: {frame_files[0]}: ") for line in lines)
    assert any("is --depth-scale, metres per unit, right?" in line for line in lines)


def test_every_option_reaches_its_place(
    run: Run, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    image, depth = frame_files
    Image.open(image).resize((64, 48)).save(image)
    np.save(tmp_path / "confidence.npy", np.zeros((24, 32), np.float32) + (np.arange(32) > 8))
    result = run(
        *(image, depth, "--json", "-o", tmp_path / "out.png", "--output-scale", 0.002),
        *("--depth-scale", 0.002, "--max-depth", 8, "--depth-grid", "registered"),
        *("--intrinsics", "60,60,32,24", "--confidence", tmp_path / "confidence.npy"),
        *("--uncertainty", tmp_path / "error.tiff", "--max-uncertainty", 0.03),
        *("--point-cloud", tmp_path / "cloud.ply", "--visualization", tmp_path / "panels.png"),
    )
    record = json.loads(result.stdout)
    written = np.asarray(Image.open(tmp_path / "out.png")) * 0.002
    assert written.shape == (48, 64)
    assert written.max() == pytest.approx(record["depth_max_m"], abs=0.001)
    assert record["depth_max_m"] < 8.01
    assert record["treated_as_missing"]["beyond_max_depth"] > 0
    assert record["untrusted"] > 0
    assert record["too_uncertain"] == (written == 0).sum() > 0
    assert record["points"] == (written > 0).sum()


@pytest.mark.parametrize(
    ("error", "code"),
    [(CheckpointError("a/:\nno unet"), 2), (MissingExtraError("ros", "rosbags"), 1)],
)
def test_what_the_model_refuses_is_one_line(
    frame_files: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: SteeredMarigoldError,
    code: int,
) -> None:
    def refuse(model: object, progress: bool = False) -> None:
        raise error

    monkeypatch.setattr(complete, "_load", refuse)
    words = ["complete", *map(str, frame_files), "-o", str(tmp_path / "out.png")]
    result = CliRunner().invoke(app, words)
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr == f"error: {str(error).replace(chr(10), ' ')}\n"


def test_the_demo_prints_three_paths(
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        demo.main()
    assert stop.value.code == 0
    paths = [line.split(": ")[1] for line in capsys.readouterr().out.splitlines()[:3]]
    assert paths == ["demo/depth.png", "demo/panels.png", "demo/cloud.ply"]
    assert all(Path(path).stat().st_size > 0 for path in paths)
