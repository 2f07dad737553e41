"""What README, docs and examples show runs, and says what the code says."""

import json
import re
import threading
from array import array
from collections.abc import Iterator
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from examples import (
    complete_frame,
    folder,
    live,
    numpy_arrays,
    own_checkpoint,
    ray_cluster,
    stream_with_poses,
    tsdf_fusion,
)
from examples.ros2.latest import LatestFrameCompleter, depth_bytes
from steered_marigold import (
    DepthCompleter,
    DepthCompletion,
    Frame,
    SteeredCompleter,
    StreamingCompleter,
    make_frame,
)
from steered_marigold.batch.engines import LocalEngine
from steered_marigold.io.depth_maps import read_depth, write_depth
from steered_marigold.io.images import read_image, write_image
from steered_marigold.io.point_clouds import read_point_cloud
from tests.frames.completers import NearestCompleter

ROOT = Path(__file__).parents[1]
CHECKPOINT = Path(str(files("steered_marigold") / "assets" / "checkpoint"))
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
pytestmark = pytest.mark.skipif(
    not (CHECKPOINT / "model_index.json").is_file(),
    reason="the embedded checkpoint is not in this checkout",
)


@pytest.fixture(scope="module")
def fast() -> DepthCompleter:
    """One model for all examples that take one."""
    return SteeredCompleter.from_checkpoint(preset="fast", device="cpu")


@pytest.fixture(scope="module")
def small() -> Frame:
    """The sample frame, every fifth pixel of it."""
    image = read_image(numpy_arrays.SAMPLE / "image.jpg").pixels[::5, ::5]
    depth = read_depth(numpy_arrays.SAMPLE / "depth.png").depth[::5, ::5]
    K = torch.tensor([[100.0, 0, 63.5], [0, 100.0, 47.5], [0, 0, 1]])
    return make_frame(image.contiguous(), depth, K=K, id="small")


def test_complete_frame(tmp_path: Path) -> None:
    completion = complete_frame.main(tmp_path)
    sensor = read_depth(complete_frame.SAMPLE / "depth.png")
    trusted = completion.trusted[0]
    assert trusted.sum() > 0.9 * sensor.valid_mask.sum()
    assert torch.equal(completion.depth[0][trusted], sensor.depth[trusted])
    assert completion.uncertainty is not None
    sure = completion.uncertainty[0] < 0.05 * completion.depth[0]
    assert len(read_point_cloud(tmp_path / "cloud.ply").points) == int(sure.sum())
    assert torch.equal(read_depth(tmp_path / "depth.exr").depth, completion.depth[0])


def test_numpy_arrays(fast: DepthCompleter, small: Frame) -> None:
    depth = small.sparse_depth.numpy()
    dense, sigma = numpy_arrays.complete(fast, small.image.numpy(), depth)
    assert dense.shape == sigma.shape == depth.shape
    assert (dense > 0).all()
    assert np.mean(dense[depth > 0] == depth[depth > 0]) > 0.9
    assert sigma[depth == 0].mean() > sigma[depth > 0].mean()


def test_folder(fast: DepthCompleter, small: Frame, tmp_path: Path) -> None:
    for frame_id, depth in (("a", small.sparse_depth), ("b", 0 * small.sparse_depth)):
        for name in ("images", "depths"):
            (tmp_path / name).mkdir(exist_ok=True)
        write_image(tmp_path / "images" / f"{frame_id}.png", small.image)
        write_depth(tmp_path / "depths" / f"{frame_id}.png", depth)
    left_out = folder.main(fast, tmp_path / "images", tmp_path / "depths", tmp_path / "dense")
    assert left_out == ["b"]
    assert [path.name for path in (tmp_path / "dense").iterdir()] == ["a.png"]


def test_ray_cluster(small: Frame, tmp_path: Path) -> None:
    """On an engine of this process; tests/batch/test_cluster.py has Ray's."""
    _frame_folder(tmp_path, small, 2)
    given = tmp_path / "rgb", tmp_path / "depth", tmp_path / "dense"
    assert ray_cluster.main(LocalEngine(), *given) == 0
    assert sorted(path.name for path in given[2].glob("*.png")) == ["0.png", "1.png"]
    given[2].joinpath("1.png").unlink()
    assert ray_cluster.main(LocalEngine(), *given) == 0
    assert given[2].joinpath("1.png").is_file()


@pytest.mark.skipif(find_spec("rosbags") is None, reason="needs the extra ros")
def test_recording(tmp_path: Path) -> None:
    from examples import recording
    from tests.io.bags import building

    bag = tmp_path / "in.bag"
    building.write_bag(bag, "ros1", building.camera_entries(building.Builder(1), 3))
    completer = NearestCompleter()
    tally = recording.copy_with_depth(completer, bag, tmp_path / "out.bag")
    assert (tally.completed, tally.failed) == (3, {})
    again = recording.first_frame(completer, tmp_path / "out.bag")
    assert again.depth.shape == (1, 6, 8)


def test_live(fast: DepthCompleter, small: Frame, tmp_path: Path) -> None:
    """What was captured goes through, what has no measurement does not."""
    image, depth = small.image.numpy(), small.sparse_depth.numpy()
    shown: list[live.LiveFrame] = []
    live.run(fast, [(image, depth), (image, 0 * depth), (image, depth)], shown.append)
    assert len(shown) == 2
    assert all(frame.rate > 0 and (frame.completed > 0).all() for frame in shown)
    assert np.array_equal(shown[1].measured, depth)
    writer = live.PictureWriter(tmp_path / "pictures")
    writer(shown[0])
    assert read_image(tmp_path / "pictures" / "000000.png").pixels.shape[1] > 400


def test_stream_with_poses(fast: DepthCompleter, small: Frame, tmp_path: Path) -> None:
    """What the first frame measured stands in the hole of the second, whose camera did not move."""
    _frame_folder(tmp_path, small, 2)
    hole = small.sparse_depth.clone()
    hole[30:60, 40:90] = 0
    write_depth(tmp_path / "depth" / "1.png", hole)
    (tmp_path / "pose").mkdir()
    for index in range(2):
        np.savetxt(tmp_path / "pose" / f"{index}.txt", np.eye(4))
    found = list(stream_with_poses.frames(tmp_path, "100,100,63.5,47.5"))
    count = stream_with_poses.main(StreamingCompleter(fast), iter(found), tmp_path / "dense")
    assert count == 2
    dense = read_depth(tmp_path / "dense" / "1.png").depth
    hidden = (hole == 0) & small.valid_mask
    error = (dense - small.sparse_depth)[hidden].abs() / small.sparse_depth[hidden]
    assert hidden.sum() > 500
    assert float(error.median()) < 0.01


@pytest.mark.parametrize("camera", live.CAMERAS)
def test_cameras_need_their_library(camera: str) -> None:
    module = {"realsense": "pyrealsense2", "orbbec": "pyorbbecsdk", "oak": "depthai"}.get(camera)
    if module is None:
        assert list(live.CAMERAS[camera]()) == []  # OpenCV's wheel has no OpenNI
    elif find_spec(module) is None:
        with pytest.raises(ImportError, match=module):
            next(iter(live.CAMERAS[camera]()))


def test_own_checkpoint() -> None:
    completion = own_checkpoint.main(CHECKPOINT, steps=2)
    assert completion.exact_codec_steps + completion.linear_codec_steps == 2
    assert (completion.depth > 0).all()


def _frame_folder(path: Path, frame: Frame, count: int) -> None:
    for name in ("rgb", "depth"):
        (path / name).mkdir(parents=True)
    for index in range(count):
        write_image(path / "rgb" / f"{index}.png", frame.image)
        write_depth(path / "depth" / f"{index}.png", frame.sparse_depth)


def test_own_method(small: Frame, tmp_path: Path) -> None:
    from examples import own_method

    _frame_folder(tmp_path / "frames", small, 2)
    table = own_method.main(tmp_path / "frames", tmp_path / "run", others=("nearest",))
    assert "| row-median |" in table
    assert "| nearest |" in table


def test_own_dataset(small: Frame, tmp_path: Path) -> None:
    from examples import own_dataset

    depth = small.sparse_depth.numpy()
    for index in range(2):
        lidar = np.where(np.arange(len(depth))[:, None] % 4 == index, depth, 0)
        np.savez(tmp_path / f"{index}.npz", image=small.image.numpy(), lidar=lidar, depth=depth)
    table = own_dataset.main(tmp_path, tmp_path / "run", methods=("nearest", "linear"))
    assert "| linear |" in table


def test_sure_depth_alone_is_fused(fast: DepthCompleter, small: Frame) -> None:
    depth = tsdf_fusion.sure_depth(fast, small)
    measured = small.valid_mask.numpy()
    assert (depth[measured] > 0).mean() > 0.9
    assert (depth[~measured] == 0).any()


@pytest.mark.skipif(find_spec("open3d") is None, reason="needs open3d")
def test_tsdf_fusion(fast: DepthCompleter, small: Frame, tmp_path: Path) -> None:
    tsdf_fusion.fuse(fast, [(small, np.eye(4))], tmp_path / "mesh.ply")
    assert (tmp_path / "mesh.ply").stat().st_size > 1000


class _Waiting(NearestCompleter):
    """Completes when it is told to."""

    def __init__(self) -> None:
        self.begun, self.go = threading.Event(), threading.Event()

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        self.begun.set()
        assert self.go.wait(20)
        return super()._complete(frame, generator)


def _message(pixels: NDArray[Any], encoding: str, milliseconds: int) -> SimpleNamespace:
    """As rclpy has an Image: its data is an array of bytes."""
    stamp = SimpleNamespace(sec=7, nanosec=milliseconds * 10**6)
    height, width = pixels.shape[:2]
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id="camera"),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].nbytes,
        data=array("B", pixels.tobytes()),
    )


def test_the_latest_frame_wins(small: Frame) -> None:
    """While one is completed, what waits is replaced; damage is told, and ends nothing."""
    completer, answers, told = _Waiting(), list[tuple[Any, DepthCompletion]](), list[str]()
    frames = LatestFrameCompleter(completer, lambda *pair: answers.append(pair), refuse=told.append)
    image = small.image.numpy()
    codes = (small.sparse_depth.numpy() * 1000).astype(np.uint16)

    def send(milliseconds: int, depth: NDArray[np.uint16] = codes) -> None:
        frames.on_image(_message(image, "rgb8", milliseconds))
        frames.on_depth(_message(depth, "16UC1", milliseconds + 5))

    send(0)
    assert completer.begun.wait(20)
    for milliseconds in (33, 66, 99):
        send(milliseconds)
    frames.on_depth(_message(codes, "16UC1", 500))  # its colour never came
    completer.go.set()
    frames.stop()
    assert [depth.header.stamp.nanosec // 10**6 for depth, _ in answers] == [5, 104]
    assert (frames.completed, frames.replaced, told) == (2, 2, [])
    data = np.frombuffer(depth_bytes(answers[0][1]), np.float32).reshape(codes.shape)
    assert np.abs(data[codes > 0] - codes[codes > 0] / 1000).max() < 2e-3

    frames = LatestFrameCompleter(completer, lambda *pair: answers.append(pair), refuse=told.append)
    send(0, 0 * codes)
    frames.stop()
    assert len(answers) == 2
    assert "nothing was measured" in told[0]


def _cells() -> Iterator[str]:
    notebook = json.loads((ROOT / "examples" / "quickstart.ipynb").read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            yield "".join(cell["source"])


def test_notebook() -> None:
    names: dict[str, Any] = {}
    for cell in _cells():
        exec(compile(cell, "quickstart.ipynb", "exec"), names)
    assert "data:image/jpeg;base64," in names["completion"]._repr_html_()  # a cell's last line
    assert names["largest_change"] < 1e-5
    assert np.median(names["error"]) < 0.2


@pytest.mark.slow
def test_own_training(small: Frame, tmp_path: Path) -> None:
    from examples import own_training
    from steered_marigold.diffusion.checkpoints import load_pipeline

    _frame_folder(tmp_path / "frames", small, 12)
    checkpoint = own_training.main(tmp_path / "frames", tmp_path / "out", minutes=0.01, pool=32)
    assert (tmp_path / "out" / "runs" / "denoiser" / "log.csv").is_file()
    pipe = load_pipeline(str(checkpoint), device="cpu")
    image = small.image.permute(2, 0, 1).float() / 255
    assert (pipe(image, small.sparse_depth, preset="fast").depth > 0).all()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages(page: Path) -> None:
    links = re.findall(r"\]\(((?!https?:)[^)#]+\.(?:md|py))[^)]*\)", page.read_text("utf-8"))
    assert [link for link in links if not (page.parent / link).is_file()] == []
