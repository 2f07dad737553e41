import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from steered_marigold.cli import app
from steered_marigold.cli.evaluate import _method_labels
from steered_marigold.errors import InputError


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Six frames of 80x60 px."""
    folder = tmp_path / "frames"
    rng = np.random.default_rng(0)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for index in range(6):
        image = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)
        Image.fromarray(image).save(folder / "rgb" / f"{index}.png")
        depth = 1000 + 40 * np.mgrid[:60, :80][rng.integers(2)] + rng.integers(0, 300, (60, 80))
        Image.fromarray(depth.astype(np.uint16)).save(folder / "depth" / f"{index}.png")
    return folder


def evaluate(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


def rows(folder: Path) -> list[dict[str, Any]]:
    """The summary's rows without their times."""
    summary = json.loads((folder / "summary.json").read_text())
    return [{k: v for k, v in row.items() if k != "seconds_per_image"} for row in summary["rows"]]


LIDAR = ("--protocol", "lidar", "--lines", "8", "--methods", "nearest,linear")


def test_writes_every_file_of_a_run(frames: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = evaluate("folder", frames, *LIDAR, "--limit", 3, "-o", out)
    assert result.exit_code == 0, result.output
    assert {path.name for path in out.iterdir()} == {
        "comparisons.csv",
        "per_image.csv",
        "predictions",
        "report.html",
        "results.jsonl",
        "run.json",
        "summary.json",
        "table.md",
        "table.tex",
    }
    assert [(row["method"], row["area"], row["images"]) for row in rows(out)] == [
        (method, area, 3)
        for method in ("nearest", "linear")
        for area in ("full", "measured", "hidden")
    ]
    assert "| linear |" in result.stdout
    assert str(out / "report.html") in result.stdout.replace("\n", "")


def test_predictions_may_be_left_out(frames: Path, tmp_path: Path) -> None:
    run = ("folder", frames, *LIDAR, "--limit", 1, "--no-predictions", "-o", tmp_path)
    assert evaluate(*run).exit_code == 0
    assert not (tmp_path / "predictions").exists()
    assert (tmp_path / "report.html").is_file()
    drawn = CliRunner().invoke(app, ["figures", str(tmp_path)])
    assert drawn.exit_code == 0, drawn.output
    assert (tmp_path / "figures" / "comparison.png").is_file()


def test_a_killed_run_resumes_to_the_same_summary(frames: Path, tmp_path: Path) -> None:
    """SIGKILL in the middle: nothing that was recorded is lost or done again."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    arguments = ("folder", str(frames), *LIDAR, "--seed", "3", "-o")
    command = (sys.executable, "-c", "from steered_marigold.cli import main; main()", "evaluate")
    process = subprocess.Popen([*command, *arguments, str(killed)], stdout=subprocess.DEVNULL)
    log = killed / "results.jsonl"
    deadline = time.monotonic() + 120
    while not (log.is_file() and log.stat().st_size) and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (killed / "summary.json").exists()
    before = log.read_bytes()
    for folder in (killed, whole):
        assert evaluate(*arguments, folder).exit_code == 0
    assert log.read_bytes().startswith(before[: before.rfind(b"\n") + 1])
    assert len(log.read_bytes().splitlines()) == 12
    assert rows(killed) == rows(whole)


def test_a_failing_image_makes_the_exit_code_1(frames: Path, tmp_path: Path) -> None:
    (frames / "depth" / "4.png").write_bytes(b"not a PNG")
    result = evaluate("folder", frames, *LIDAR, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert "nearest, frame 4: " in result.stderr
    assert "2 images failed" in result.stderr
    assert {(row["images"], row["failed"]) for row in rows(tmp_path / "out")} == {(5, 1)}


def test_a_method_without_weights_is_left_out_with_one_line(frames: Path, tmp_path: Path) -> None:
    result = evaluate(
        "folder",
        frames,
        "--protocol",
        "objects",
        "--methods",
        "nearest,bpnet",
        "-o",
        tmp_path / "o",
    )
    assert result.exit_code == 0
    lines = [line for line in result.stderr.splitlines() if line.startswith("warning")]
    assert len(lines) == 1
    assert "bpnet is left out" in lines[0]
    assert {row["method"] for row in rows(tmp_path / "o")} == {"nearest"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nowhere", "."), "data set 'nowhere' is not known"),
        (("folder", "absent"), "absent"),
        (("kitti", "absent"), "absent"),
        (("nyuv2", "absent.mat"), "horatio.cs.nyu.edu"),
        (("folder", None, "--protocol", "random"), "protocol 'random' is not known"),
        (("folder", None, "--protocol", "range", "--points", "5"), "does not read points"),
        (("folder", None, "--methods", "nearst"), "nearst"),
        (("folder", None, "--methods", "linear,linear"), "one of them twice"),
        (("folder", None, "--methods", "linear@size=3"), "size"),
        (("folder", None, "--weights", "bpnet"), "must be METHOD=FILE"),
        (("folder", None, "--frames", "absent.txt"), "absent.txt"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    frames: Path, tmp_path: Path, arguments: tuple[str | None, ...], message: str
) -> None:
    out = tmp_path / "out"
    given = [frames if argument is None else argument for argument in arguments]
    result = evaluate(*given, "-o", out)
    assert result.exit_code == 2, result.output
    assert len(result.stderr.splitlines()) == 1
    assert message in result.stderr
    assert not out.exists()


def test_another_run_is_not_overwritten_unless_told(frames: Path, tmp_path: Path) -> None:
    run = ("folder", frames, *LIDAR, "--limit", 1, "-o", tmp_path)
    assert evaluate(*run).exit_code == 0
    refused = evaluate(*run, "--seed", 1)
    assert refused.exit_code == 2
    assert "another seed" in refused.stderr
    assert evaluate(*run, "--seed", 1, "--overwrite").exit_code == 0


def test_methods_are_split_outside_their_settings() -> None:
    assert _method_labels("linear, paper@a=1,b=2,marigold") == (
        "linear",
        "paper@a=1,b=2",
        "marigold",
    )
    for text in (",", "linear,linear", "steered,default"):
        with pytest.raises(InputError, match="names no method, or one of them twice"):
            _method_labels(text)


def test_former_names_are_understood_with_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    assert _method_labels("steered:paper@a=1,steered") == ("paper@a=1", "default")
    assert capsys.readouterr().err.splitlines() == [
        "warning: steered:paper@a=1 is called paper@a=1 now; the old name goes with version 0.3",
        "warning: steered is called default now; the old name goes with version 0.3",
    ]
