"""Frames on disk: shards of 100, each written whole or not at all, so that a run can resume."""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from rooms.bank import use_crops
from rooms.render import RoomFrame, render_room, render_street

FRAMES_PER_SHARD = 100
DRAWN, CROPS = "shard", "crops"


def first_seed(seed: int) -> int:
    """The room of a run's first frame; a run may have a million."""
    return seed * 1_000_000


def shard_path(folder: Path, index: int, *, crops: bool = False) -> Path:
    """Where shard `index` is; one whose textures are photographs has a name of its own."""
    return folder / f"{CROPS if crops else DRAWN}_{index:05d}.npz"


def shards_in(folder: Path, name: str) -> list[Path]:
    """All shards of a folder whose textures are `DRAWN`, or `CROPS` of photographs."""
    return sorted(folder.glob(f"{name}_*.npz"))


def write_shards(
    folder: Path,
    *,
    frames: int,
    size: tuple[int, int],
    workers: int,
    seed: int,
    streets: bool = False,
    crops: Path | None = None,
) -> Iterator[Path]:
    """Renders what is missing of `frames` frames (width, height) and yields each new shard.

    A shard holds image uint8 [n, height, width, 3], depth uint16 [n, height, width] in
    millimetres, 65535 for the sky, and K float32 [n, 3, 3]. Frame i of the run is the room, or
    street, of first_seed(seed) + i. crops: a file of textures for `use_crops`, of which each shard
    draws its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tasks, render = [], render_street if streets else render_room
    for first in range(0, frames, FRAMES_PER_SHARD):
        path = shard_path(folder, first // FRAMES_PER_SHARD, crops=crops is not None)
        last = min(first + FRAMES_PER_SHARD, frames)
        if _frames_in(path) != last - first:
            seeds = range(first_seed(seed) + first, first_seed(seed) + last)
            tasks.append(_Task(path, seeds, size, render, crops))
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


@dataclass(frozen=True)
class _Task:
    path: Path
    seeds: range
    size: tuple[int, int]
    render: Callable[..., RoomFrame]
    crops: Path | None


def _write_shard(task: _Task) -> Path:
    cv2.setNumThreads(1)
    if task.crops is not None:
        with np.load(task.crops) as crops:
            use_crops(crops, task.seeds.start)
    width, height = task.size
    rendered = [task.render(seed, width=width, height=height) for seed in task.seeds]
    millimetres = [np.minimum(np.round(frame.depth * 1000), 65535) for frame in rendered]
    path = task.path
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        np.savez(
            file,
            image=np.stack([frame.image for frame in rendered]),
            depth=np.stack(millimetres).astype(np.uint16),
            K=np.stack([frame.K.astype(np.float32) for frame in rendered]),
        )
    temporary.replace(path)
    return path
