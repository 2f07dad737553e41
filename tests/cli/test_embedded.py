"""The command as a user runs it, with the embedded checkpoint, in its own process."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import steered_marigold

PACKAGE = Path(steered_marigold.__file__).parent
SAMPLE = PACKAGE / "assets" / "sample"


def run(*words: object) -> subprocess.CompletedProcess[str]:
    command = "from steered_marigold.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", command, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_the_checkpoint_is_small() -> None:
    size = sum(p.stat().st_size for p in (PACKAGE / "assets" / "checkpoint").rglob("*"))
    assert size < 30e6


def test_a_folder_gives_the_bytes_of_single_runs(tmp_path: Path) -> None:
    frames = {"rgb": SAMPLE / "image.jpg", "depth": SAMPLE / "depth.png"}
    for kind, file in frames.items():
        (tmp_path / kind).mkdir()
        for stem in ("a", "b"):
            (tmp_path / kind / f"{stem}{file.suffix}").write_bytes(file.read_bytes())
    options = ("--preset", "fast", "--seed", 3, "--json")
    folder = run("complete", tmp_path / "rgb", tmp_path / "depth", "-o", tmp_path / "out", *options)
    assert folder.returncode == 0, folder.stderr
    single = run("complete", *frames.values(), "-o", tmp_path / "single.png", *options)
    assert single.returncode == 0, single.stderr
    written = {(tmp_path / "out" / f"{stem}.png").read_bytes() for stem in ("a", "b")}
    assert written == {(tmp_path / "single.png").read_bytes()}

    record = json.loads(single.stdout)
    assert record["metric"] is True
    assert record["checkpoint"] == "embedded"
    depth = np.asarray(Image.open(tmp_path / "single.png"))
    assert depth.shape == (480, 640)
    assert depth.min() > 0
    measured = np.asarray(Image.open(SAMPLE / "depth.png"))
    kept = np.abs(depth.astype(int) - measured)[measured > 0] <= 1
    assert kept.mean() > 0.97


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--checkpoint", "no/such/folder", "neither"),
        ("--preset", "best", "preset"),
        ("--device", "toaster", "toaster"),
    ],
)
def test_what_cannot_run_says_so(tmp_path: Path, option: str, value: str, message: str) -> None:
    result = run(
        "complete", SAMPLE / "image.jpg", SAMPLE / "depth.png", "-o", tmp_path / "o.png",
        option, value,
    )  # fmt: skip
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "o.png").exists()
