"""Samples come from all sources; rendered ones without photographs stay so."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from rooms.shards import CROPS
from training.data import HEIGHT, WIDTH
from training.mixture import MixedFrames, Sources


def shard(path: Path, depth_mm: int) -> None:
    """Two frames of a slanting wall that begins at this depth."""
    depth = np.tile(depth_mm + np.arange(WIDTH), (2, HEIGHT, 1)).astype(np.uint16)
    image = np.full((2, HEIGHT, WIDTH, 3), 128, np.uint8)
    np.savez(path, image=image, depth=depth)


def test_frames_of_several_folders_and_of_shards_that_come_later(tmp_path: Path) -> None:
    for name, depth in (("a", 1000), ("b", 2000)):
        (tmp_path / name).mkdir()
        shard(tmp_path / name / "shard_00000.npz", depth)
    samples = iter(MixedFrames(Sources(rooms=[tmp_path / "a", tmp_path / "b"]), seed=0))
    found = [float(s["range"][0]) for s in islice(samples, 8)]
    assert min(found) < 1.5 < 2 <= max(found)
    shard(tmp_path / "a" / "shard_00001.npz", 5000)
    assert max(float(s["range"][0]) for s in islice(samples, 12)) > 5


def test_textures_of_photographs_do_not_train_procedural_weights(tmp_path: Path) -> None:
    shard(tmp_path / f"{CROPS}_00000.npz", 1000)
    with pytest.raises(ValueError, match="photographs"):
        MixedFrames(Sources(rooms=[tmp_path]), seed=0)


def test_no_frames_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no training data"):
        MixedFrames(Sources(rooms=[tmp_path]), seed=0)


def test_photographs_and_their_holes(rgbd: Path) -> None:
    samples = list(islice(iter(MixedFrames(Sources(rgbd=rgbd), seed=0)), 12))
    assert any(not s["known"].all() for s in samples)
    for sample in samples:
        assert sample["known"].float().mean() > 0.25
        assert sample["depth"].abs().max() <= 1
