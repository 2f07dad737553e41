"""The command itself: what it refuses, how it says so, and what it imports."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from steered_marigold.cli import app

HEAVY = ["torch", "diffusers", "transformers", "cv2", "matplotlib", "numpy", "PIL", "scipy"]


def _invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def _save(path: Path, array: np.ndarray) -> Path:
    Image.fromarray(array).save(path)
    return path


def _refused(folder: Path, *arguments: object) -> str:
    """The one line on stderr of a `complete` that ends with exit code 2 and writes nothing."""
    before = sorted(folder.rglob("*"))
    result = _invoke("complete", *arguments, "-o", folder / "out.png")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert sorted(folder.rglob("*")) == before
    lines: list[str] = result.stderr.splitlines()
    assert lines[-1].startswith("error: ")
    assert all(line.startswith("warning: ") for line in lines[:-1])
    return lines[-1]


def test_missing_files(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    assert "nope.png: no such file" in _refused(tmp_path, image, tmp_path / "nope.png")
    assert "nope.jpg: no such file" in _refused(tmp_path, tmp_path / "nope.jpg", depth)


def test_files_that_are_no_images(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    image.write_text("hello")
    assert "image.png: damaged, or not of its kind" in _refused(tmp_path, image, depth)


def test_truncated_files(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    for broken in frame_files:
        content = broken.read_bytes()
        broken.write_bytes(content[: len(content) // 2])
        assert f"{broken.name}: damaged" in _refused(tmp_path, *frame_files)
        broken.write_bytes(content)


def test_sizes_that_differ(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    _save(depth, np.ones((24, 30), np.uint16))
    line = _refused(tmp_path, image, depth)
    assert "32x24" in line
    assert "30x24" in line


def test_pictures_of_depth(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    _save(depth, np.arange(24 * 32 * 3).astype(np.uint8).reshape(24, 32, 3))
    assert "several channels" in _refused(tmp_path, image, depth)
    _save(depth, np.ones((24, 32), np.uint8))
    assert "256 levels" in _refused(tmp_path, image, depth)


def test_nothing_measured(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    _save(depth, np.zeros((24, 32), np.uint16))
    assert "no valid pixel (768 zero); --no-measurements" in _refused(tmp_path, image, depth)
    assert "DEPTH is missing" in _refused(tmp_path, image)
    weighed = (image, "--no-measurements", "--confidence", tmp_path / "c.png")
    assert "--confidence weighs measurements: give DEPTH too" in _refused(tmp_path, *weighed)


def test_everything_beyond_the_maximum_depth(
    frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    line = _refused(tmp_path, *frame_files, "--max-depth", 0.1)
    assert "beyond max depth" in line


def test_unknown_extensions(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    assert "'.doc'" in _refused(tmp_path, image, depth.rename(tmp_path / "depth.doc"))
    assert "'.bmp'" in _refused(tmp_path, image, depth, "--uncertainty", tmp_path / "a.bmp")
    for option in ("--uncertainty", "--visualization", "--point-cloud"):
        assert "'.doc'" in _refused(tmp_path, image, depth, option, tmp_path / "a.doc")


def test_unwritable_outputs(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    missing = tmp_path / "missing" / "panels.png"
    assert "create it" in _refused(tmp_path, *frame_files, "--visualization", missing)
    assert "is an input" in _refused(tmp_path, *frame_files, "--uncertainty", frame_files[1])


def test_image_bombs(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = frame_files
    Image.new("1", (10_001, 10_000)).save(image)
    assert "over 100 megapixels" in _refused(tmp_path, image, depth)


def test_arguments_that_cannot_be_meant(frame_files: tuple[Path, Path], tmp_path: Path) -> None:
    for arguments, problem in (
        (("--sensor-noise", "a lot"), "--sensor-noise a lot: give metres"),
        (("--sensor-noise", "-1%"), "--sensor-noise -1%"),
        (("--max-uncertainty", "0"), "--max-uncertainty must be"),
        (("--max-uncertainty", "nan"), "--max-uncertainty must be"),
        (("--depth-scale", "-1"), "--depth-scale must be"),
        (("--max-depth", "0"), "--max-depth must be"),
        (("--output-scale", "0"), "--output-scale must be"),
        (("--set", "speed=1"), "has no setting 'speed'"),
        (("--intrinsics", "1,2,3"), "1,2,3: 3 numbers are no intrinsics"),
        (("--point-cloud", tmp_path / "a.ply"), "--intrinsics"),
    ):
        assert problem in _refused(tmp_path, *frame_files, *arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("a", "b", "--steps", "0"),
        ("a", "b", "--dtype", "int8"),
        ("a", "b", "--depth-grid", "x"),
    ],
)
def test_usage_errors(arguments: tuple[str, ...]) -> None:
    assert _invoke("complete", *arguments).exit_code == 2


def test_folders_and_files_do_not_mix(
    frame_files: tuple[Path, Path], frame_folders: tuple[Path, Path]
) -> None:
    result = _invoke("complete", frame_folders[0], frame_files[1])
    assert (result.exit_code, "must be one too" in result.stderr) == (2, True)


def test_help_names_what_newcomers_need() -> None:
    result = _invoke("complete", "--help")
    assert result.exit_code == 0
    text = " ".join(result.stdout.replace("│", " ").split())
    for words in ("0.00390625", "uint16 millimetres", "--no-measurements", "embedded"):
        assert words in text


def test_help_imports_nothing_heavy() -> None:
    code = f"""
import sys
from steered_marigold.cli import main
sys.argv = ["steered-marigold", "complete", "--help"]
try:
    main()
except SystemExit as stop:
    loaded = sorted(set({HEAVY}) & set(sys.modules))
    assert (stop.code, loaded) == (0, []), loaded
"""
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_the_installed_command_fails_with_one_line(
    frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    command = Path(sys.executable).with_name("steered-marigold")
    version = subprocess.run([command, "--version"], check=True, capture_output=True, text=True)
    assert version.stdout.count(".") == 2
    run = subprocess.run(
        [command, "complete", frame_files[0], tmp_path / "nope.png"], capture_output=True, text=True
    )
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"error: {tmp_path / 'nope.png'}: no such file\n"
