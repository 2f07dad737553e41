"""Damaged files of every kind are read, or refused with one named error; never anything else.

FAULTS: how many mutations in all; `make faults` asks for 10 000.
"""

import json
import os
import resource
import sys
import tarfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from PIL import Image

from steered_marigold.batch.job import JobSettings, plan
from steered_marigold.batch.manifest import describe_settings, require_same_settings
from steered_marigold.batch.run import complete_all
from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.diffusion.checkpoints import load_pipeline
from steered_marigold.errors import SteeredMarigoldError
from steered_marigold.evaluation.results import ResultLog
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.shards import shard_source
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
from steered_marigold.io.bags import open_recording
from steered_marigold.io.confidence_maps import read_confidence
from steered_marigold.io.depth_maps import read_depth, write_depth
from steered_marigold.io.extrinsics import read_extrinsics
from steered_marigold.io.images import read_image
from steered_marigold.io.intrinsics import read_intrinsics
from steered_marigold.io.point_clouds import PointCloud, read_point_cloud, write_point_cloud
from steered_marigold.io.shards import _row_group
from tests.batch.workers import load
from tests.diffusion.conftest import tiny_pipeline
from tests.faults.mutations import Edit, damaged, edits
from tests.frames.completers import write_frame
from tests.io.bags.building import bag_path, builder_for, camera_entries, write_bag

ALL = int(os.environ.get("FAULTS", "300"))
RANDOM = "FAULTS" in os.environ
SLOWEST_S = 5.0
MOST_BYTES = 2 * 2**30

SIZE = (12, 16)


@dataclass(frozen=True)
class Case:
    """A whole file, and what reads it; `read` checks what it gives."""

    path: Path
    read: Callable[[], object]


def _depth(path: Path, **how: Any) -> None:
    found = read_depth(path, **how)
    measured = found.depth[found.valid_mask]
    assert torch.isfinite(measured).all()
    assert (measured > 0).all()


def _depth_files(folder: Path) -> dict[str, Case]:
    metres = np.linspace(0.5, 5, SIZE[0] * SIZE[1], dtype=np.float32).reshape(SIZE)
    codes = (metres * 1000).astype(np.uint16)
    Image.fromarray(codes).save(folder / "depth.png")
    np.save(folder / "depth.npy", metres)
    np.savez_compressed(folder / "depth.npz", depth=metres)
    Image.fromarray(metres).save(folder / "depth.tiff")
    write_depth(folder / "depth.exr", torch.from_numpy(metres))
    header = f"Pf\n{SIZE[1]} {SIZE[0]}\n-1.0\n".encode()
    (folder / "depth.pfm").write_bytes(header + metres[::-1].tobytes())
    header = f"P5\n{SIZE[1]} {SIZE[0]}\n65535\n".encode()
    (folder / "depth.pgm").write_bytes(header + codes.astype(">u2").tobytes())
    kinds = ("png", "npy", "npz", "tiff", "exr", "pfm", "pgm")
    paths = {f"depth {kind}": folder / f"depth.{kind}" for kind in kinds}
    return {name: Case(path, partial(_depth, path)) for name, path in paths.items()}


def _images(folder: Path) -> dict[str, Case]:
    pixels = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), dtype=np.uint8)
    cases = {}
    for kind in ("jpg", "png"):
        path = folder / f"image.{kind}"
        Image.fromarray(pixels).save(path)
        cases[f"image {kind}"] = Case(path, partial(read_image, path))
    weights = folder / "confidence.npy"
    np.save(weights, np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4))
    cases["confidence npy"] = Case(weights, partial(read_confidence, weights))
    levels = folder / "confidence.png"
    Image.fromarray(pixels[..., 0]).save(levels)
    cases["confidence png"] = Case(levels, partial(read_confidence, levels))
    cloud = folder / "cloud.ply"
    points = torch.rand(20, 3)
    write_point_cloud(
        cloud, PointCloud(points=points, colors=torch.zeros(20, 3, dtype=torch.uint8))
    )
    cases["point cloud"] = Case(cloud, partial(read_point_cloud, cloud))
    return cases


def _cameras(folder: Path) -> dict[str, Case]:
    texts = {
        "camera.txt": "# K\n460.5 0 325.0\n0 461.5 241.5\n0 0 1\n",
        "camera.yaml": "image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [460.5, 0, 325.0, 0, 461.5, 241.5, 0, 0, 1]\n",
        "camera.json": json.dumps(
            {"width": 640, "height": 480, "intrinsic_matrix": [460, 0, 0, 0, 461, 0, 325, 241, 1]}
        ),
    }
    cases = {}
    for name, text in texts.items():
        path = folder / name
        path.write_text(text)
        cases[name] = Case(path, partial(_camera, path))
    pose = folder / "pose.txt"
    np.savetxt(pose, np.eye(4))
    return cases | {"pose": Case(pose, partial(_pose, pose))}


def _camera(path: Path) -> None:
    K, _ = read_intrinsics(path).for_image((480, 640))
    assert torch.isfinite(K).all()
    assert K[0, 0] > 0


def _pose(path: Path) -> None:
    assert torch.isfinite(read_extrinsics(path)).all()


def _bags(folder: Path) -> dict[str, Case]:
    cases = {}
    for kind in ("ros1", "sqlite3", "mcap_file"):
        path = bag_path(folder, kind, kind)
        write_bag(path, kind, camera_entries(builder_for(kind), count=2))
        file = path if path.is_file() else next(path.glob("*.db3"))
        cases[f"bag {kind}"] = Case(file, partial(_recording, path))
    return cases


def _recording(path: Path) -> None:
    with open_recording(path) as recording:
        for frame in recording.frames():
            recorded_frame(frame)


def _checkpoint(folder: Path) -> dict[str, Case]:
    root = folder / "checkpoint"
    tiny_pipeline(with_image_encoder=True).save_pretrained(root)
    files = sorted(p for p in root.rglob("*") if p.suffix in (".json", ".safetensors"))
    read = partial(load_pipeline, str(root), device="cpu")
    return {f"checkpoint {p.relative_to(root).as_posix()}": Case(p, read) for p in files}


def _manifests(folder: Path) -> dict[str, Case]:
    images, depths, out = folder / "run images", folder / "run depths", folder / "run out"
    images.mkdir()
    depths.mkdir()
    write_frame(images / "0.png", depths / "0.png", seed=0)
    inputs, reading = FrameFiles(image=images, depth=depths), Reading()
    todo = plan(folder_source(inputs, reading), Outputs(depth=out), suffix=".png", overwrite=False)
    how = describe_settings(inputs, reading, JobSettings(), {}, ".png")
    assert not any(x.error for x in complete_all(load, todo, JobSettings(), how))
    log = folder / "results.jsonl"
    log.write_text('{"method": "a", "frame_id": "1", "areas": {}}\n' * 3)
    return {
        "run.json": Case(out / ".run/run.json", partial(require_same_settings, todo, how)),
        "results.jsonl": Case(log, ResultLog(log).read),
    }


def _shards(folder: Path) -> dict[str, Case]:
    image, depth = folder / "1.png", folder / "1.depth.png"
    write_frame(image, depth, seed=0)
    with tarfile.open(folder / "shard.tar", "w") as tar:
        for path in (image, depth):
            tar.add(path, path.name)
    cases = {"tar": Case(folder / "shard.tar", partial(_shard, folder / "shard.tar"))}
    with suppress(ImportError):
        from pyarrow import table
        from pyarrow.parquet import write_table

        path = folder / "shard.parquet"
        columns = {"image": [image.read_bytes()], "depth": [depth.read_bytes()]}
        write_table(table({"id": ["1"], **columns}), path)
        cases["parquet"] = Case(path, partial(_shard, path))
    return cases


def _shard(path: Path) -> None:
    _row_group.cache_clear()
    source = shard_source(path, Reading())
    for frame_id in source.ids:
        source.load(frame_id)


MAKERS = (_depth_files, _images, _cameras, _bags, _checkpoint, _manifests, _shards)


@pytest.mark.parametrize("maker", MAKERS, ids=lambda maker: maker.__name__.strip("_"))
def test_damaged_files_are_read_or_refused(
    maker: Callable[[Path], dict[str, Case]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One family of formats; names the case and keeps the file of what it finds."""
    cases = maker(tmp_path)
    capsys.readouterr()
    before = _peak_bytes()
    for name, case in cases.items():
        whole = case.path.read_bytes()
        case.read()
        _attempts(name, case, whole)
        case.path.write_bytes(whole)
    assert capsys.readouterr().out == ""
    assert _peak_bytes() - before < MOST_BYTES


def _attempts(name: str, case: Case, whole: bytes) -> None:
    """Many mutations of one file."""

    @settings(
        max_examples=max(3, ALL // 32),
        derandomize=not RANDOM,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(changes=edits)
    def attempt(changes: list[Edit]) -> None:
        case.path.write_bytes(damaged(whole, changes))
        started = time.process_time()
        with suppress(SteeredMarigoldError):
            case.read()
        assert time.process_time() - started < SLOWEST_S, name

    attempt()


def _peak_bytes() -> int:
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
