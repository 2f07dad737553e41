"""--rerun of every command: what is written for Rerun is there when it is read back."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from steered_marigold.cli import app
from steered_marigold.frames.viewing import TIMELINE

chunk = pytest.importorskip("rerun.chunk")

K = "40,40,31.5,23.5"


def run(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


def shown(path: Path) -> dict[str, int]:
    """How many times each entity was written."""
    rows: Counter[str] = Counter()
    for part in chunk.RrdReader(str(path)).stream():
        if TIMELINE in part.timeline_names:
            rows[part.entity_path] += part.num_rows
    return dict(rows)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two frames with holes."""
    images, depths = tmp_path / "rgb", tmp_path / "depth"
    for folder in (images, depths):
        folder.mkdir()
    rng = np.random.default_rng(0)
    for index in range(2):
        image = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        Image.fromarray(image).save(images / f"{index}.png")
        depth = (1500 + np.mgrid[:48, :64][1] * 5).astype(np.uint16)
        depth[10:20, 10:30] = 0
        Image.fromarray(depth).save(depths / f"{index}.png")
    return images, depths


def _entities(count: int) -> dict[str, int]:
    names = (
        "camera",
        "camera/image",
        "camera/measured",
        "camera/completed",
        "cloud/measured",
        "cloud/completed",
        "uncertainty",
    )
    return {f"/{name}": count for name in names}


def test_complete_writes_one_frame(folders: tuple[Path, Path], tmp_path: Path) -> None:
    image, depth = (folder / "0.png" for folder in folders)
    path = tmp_path / "a.rrd"
    words = ("complete", image, depth, "-o", tmp_path / "a.png", "--preset", "fast")
    result = run(*words, "--intrinsics", K, "--rerun", path)
    assert result.exit_code == 0, result.output
    assert shown(path) == _entities(1)
    assert run(*words, "--rerun", tmp_path / "a.txt").exit_code == 2


def test_complete_writes_the_frames_of_folders(folders: tuple[Path, Path], tmp_path: Path) -> None:
    """Those that it completes: not those that were before."""
    path, out = tmp_path / "a.rrd", tmp_path / "out"
    words = ("complete", *folders, "-o", out, "--preset", "fast", "--intrinsics", K)
    result = run(*words, "--rerun", path)
    assert result.exit_code == 0, result.output
    assert shown(path) == _entities(2)
    (out / "1.png").unlink()
    result = run(*words, "--rerun", path)
    assert "without 1 that had their results" in result.output
    assert shown(path) == _entities(1)


@pytest.mark.parametrize("more", [("--workers", 2), ("--engine", "ray")])
def test_several_processes_write_none(
    folders: tuple[Path, Path], tmp_path: Path, more: tuple[object, ...]
) -> None:
    path = tmp_path / "a.rrd"
    result = run("complete", *folders, "-o", tmp_path / "out", "--rerun", path, *more)
    assert result.exit_code == 2
    assert "--rerun is written by one process" in result.output
    assert not path.exists()


def test_evaluate_writes_every_answer_beside_the_truth(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    path = tmp_path / "a.rrd"
    data = ("evaluate", "folder", tmp_path, "-o", tmp_path / "out", "--protocol", "lidar")
    words = (*data, "--lines", 8, "--methods", "nearest,linear", "--rerun", path)
    assert run(*words, "--no-predictions").exit_code == 2
    result = run(*words)
    assert result.exit_code == 0, result.output
    names = ("image", "measured", "nearest", "linear", "truth")
    assert shown(path) == {f"/camera/{name}": 2 for name in names}
    path.unlink()
    assert run(*words).exit_code == 0  # a run that has its results shows them again
    assert shown(path)["/camera/truth"] == 2
