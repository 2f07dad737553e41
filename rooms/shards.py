"""Frames on disk: shards of 100, each written whole or not at all, so that a run can resume."""

import multiprocessing
import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from rooms.render import render_room

FRAMES_PER_SHARD = 100


def first_seed(seed: int) -> int:
    """The room of a run's first frame; a run may have a million."""
    return seed * 1_000_000


def shard_path(folder: Path, index: int) -> Path:
    """Where shard `index` is."""
    return folder / f"shard_{index:05d}.npz"


def write_shards(
    folder: Path, *, frames: int, size: tuple[int, int], workers: int, seed: int
) -> Iterator[Path]:
    """Renders what is missing of `frames` frames (width, height) and yields each new shard.

    A shard holds image uint8 [n, height, width, 3], depth uint16 [n, height, width] in
    millimetres and K float32 [n, 3, 3]. Frame i of the run is the room of first_seed(seed) + i.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tasks = []
    for first in range(0, frames, FRAMES_PER_SHARD):
        path = shard_path(folder, first // FRAMES_PER_SHARD)
        last = min(first + FRAMES_PER_SHARD, frames)
        if _frames_in(path) != last - first:
            seeds = range(first_seed(seed) + first, first_seed(seed) + last)
            tasks.append((path, seeds, size))
    if workers == 1:
        yield from map(_write_shard, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(_write_shard, tasks)


def _frames_in(path: Path) -> int:
    if not path.exists():
        return 0
    with np.load(path) as shard:
        return len(shard["K"])


def _write_shard(task: tuple[Path, range, tuple[int, int]]) -> Path:
    path, seeds, (width, height) = task
    cv2.setNumThreads(1)
    rendered = [render_room(seed, width=width, height=height) for seed in seeds]
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        np.savez(
            file,
            image=np.stack([frame.image for frame in rendered]),
            depth=np.stack([np.round(frame.depth * 1000).astype(np.uint16) for frame in rendered]),
            K=np.stack([frame.K.astype(np.float32) for frame in rendered]),
        )
    temporary.replace(path)
    return path
