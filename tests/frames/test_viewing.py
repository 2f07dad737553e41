"""What is written for Rerun is there when it is read back."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch

from steered_marigold.core.frame import Frame, make_frame
from steered_marigold.errors import FileFormatError
from steered_marigold.frames.sources import FrameFiles, Reading
from steered_marigold.frames.viewing import (
    TIMELINE,
    ViewedCompleter,
    rerun_log,
    written_results,
)
from steered_marigold.io.depth_maps import write_depth
from steered_marigold.methods.interpolation import NearestCompleter

chunk = pytest.importorskip("rerun.chunk")


def frame_of(seed: int, stamp: float) -> Frame:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 4, (12, 16)) * (rng.random((12, 16)) < 0.5)
    K = [[20.0, 0, 8], [0, 20, 6], [0, 0, 1]]
    return make_frame(rng.random((12, 16, 3)), depth, K=K, id=str(seed), stamp=stamp)


def read_back(path: Path) -> dict[str, int]:
    """How many frames each entity has."""
    rows: Counter[str] = Counter()
    for part in chunk.RrdReader(str(path)).stream():
        if TIMELINE in part.timeline_names:
            assert "stamp" in part.timeline_names
            rows[part.entity_path] += part.num_rows
    return dict(rows)


def test_frames_are_read_back(tmp_path: Path) -> None:
    frames = [frame_of(seed, stamp=100.0 + seed) for seed in range(3)]
    with rerun_log(tmp_path / "a.rrd") as viewing:
        completer = ViewedCompleter(NearestCompleter(), viewing)
        answers = [completer.answer(frame) for frame in frames]
    assert all(
        torch.equal(a.depth, NearestCompleter().answer(f).depth)
        for a, f in zip(answers, frames, strict=True)
    )
    entities = (
        "camera",
        "camera/image",
        "camera/measured",
        "camera/completed",
        "cloud/measured",
        "cloud/completed",
    )
    assert read_back(tmp_path / "a.rrd") == {f"/{name}": 3 for name in entities}


def test_a_run_that_fails_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="stop"), rerun_log(tmp_path / "a.rrd"):
        raise RuntimeError("stop")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileFormatError, match="rrd"), rerun_log(tmp_path / "a.txt"):
        pass


def test_written_results_are_seen_again(frame_folders: tuple[Path, Path], tmp_path: Path) -> None:
    images, depths = frame_folders
    dense = tmp_path / "dense"
    dense.mkdir()
    for path in depths.iterdir():
        write_depth(dense / path.name, torch.full((24, 32), 2.0))
    files = FrameFiles(image=images, depth=depths)
    results = list(written_results(files, dense, dense, Reading()))
    assert [frame.id for frame, _ in results] == ["0000", "0001", "0002"]
    for frame, completion in results:
        assert 0 < int(frame.valid_mask.sum()) < frame.valid_mask.numel()
        assert completion.uncertainty is not None
        assert bool((completion.depth == 2.0).all())
    (single,) = written_results(
        FrameFiles(image=images / "0000.png"), dense / "0000.png", None, Reading()
    )
    assert not single[0].measured
