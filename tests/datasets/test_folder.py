import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from steered_marigold.datasets.dataset import select_frames
from steered_marigold.datasets.folder import FrameFolder
from steered_marigold.datasets.registry import DATASETS, open_dataset
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, InputError, SizeMismatchError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three frames of 12x8 px: JPEG and PNG images, 16-bit millimetres."""
    rng = np.random.default_rng(0)
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    for stem, suffix in (("b", "jpg"), ("a", "png"), ("a-c", "png")):
        image = rng.integers(0, 256, (8, 12, 3), dtype=np.uint8)
        Image.fromarray(image).save(tmp_path / "rgb" / f"{stem}.{suffix}")
        depth = rng.integers(0, 9000, (8, 12), dtype=np.uint16)
        Image.fromarray(depth).save(tmp_path / "depth" / f"{stem}.png")
    return tmp_path


def test_pairs_by_stem(folder: Path) -> None:
    dataset = FrameFolder(folder)
    assert dataset.frame_ids == ("a", "a-c", "b")
    sample = dataset.load("a")
    with Image.open(folder / "depth" / "a.png") as file:
        np.testing.assert_allclose(sample.metric_depth.numpy(), np.asarray(file) / 1000, rtol=1e-6)
    with Image.open(folder / "rgb" / "a.png") as file:
        np.testing.assert_array_equal(sample.frame.image.numpy(), np.asarray(file))
    assert sample.frame.K is None
    assert not sample.frame.measured


def test_sparse_depth_intrinsics_scale_and_range(folder: Path) -> None:
    (folder / "sparse").mkdir()
    for stem in ("a", "a-c", "b"):
        sparse = np.zeros((8, 12), np.uint16)
        sparse[2, 3], sparse[4, 5] = 1000, 60000
        Image.fromarray(sparse).save(folder / "sparse" / f"{stem}.png")
    (folder / "K.txt").write_text("10 0 6\n0 10 4\n0 0 1\n")
    sample = FrameFolder(folder, depth_scale=0.002, max_depth=50.0).load("b")
    assert sample.frame.valid_mask.nonzero().tolist() == [[2, 3]]
    assert float(sample.frame.sparse_depth[2, 3]) == pytest.approx(2.0)
    assert sample.frame.K is not None
    assert sample.frame.K.tolist() == [[10, 0, 6], [0, 10, 4], [0, 0, 1]]


def test_layout_of_marigold_dc(tmp_path: Path) -> None:
    for name in ("rgb", "sparse", "gt"):
        (tmp_path / name).mkdir()
    Image.fromarray(np.zeros((8, 12, 3), np.uint8)).save(tmp_path / "rgb" / "1.png")
    truth = np.linspace(0, 5, 96, dtype=np.float32).reshape(8, 12)
    sparse = np.where(np.arange(96).reshape(8, 12) % 10 == 0, truth, 0)
    np.save(tmp_path / "gt" / "1.npy", truth)
    np.save(tmp_path / "sparse" / "1.npy", sparse)
    sample = FrameFolder(tmp_path).load("1")
    np.testing.assert_array_equal(sample.metric_depth.numpy(), truth)
    np.testing.assert_array_equal(sample.frame.valid_mask.numpy(), sparse > 0)


@pytest.fixture
def subfolders(tmp_path: Path) -> Path:
    """Two frames, one a folder: a JPEG with 16 bits and intrinsics, a PNG with floats."""
    for name in ("b", "a", "notes"):
        (tmp_path / name).mkdir()
    image = Image.fromarray(np.full((8, 12, 3), 7, np.uint8))
    image.save(tmp_path / "a" / "rgb.jpg")
    image.save(tmp_path / "b" / "rgb.png")
    Image.fromarray(np.full((8, 12), 1500, np.uint16)).save(tmp_path / "a" / "depth.png")
    np.save(tmp_path / "b" / "depth.npy", np.full((1, 1, 8, 12), 2.5, np.float32))
    (tmp_path / "a" / "intrinsics.txt").write_text("10 0 6\n0 10 4\n0 0 1\n")
    return tmp_path


def test_one_folder_a_frame(subfolders: Path) -> None:
    dataset = FrameFolder(subfolders)
    assert dataset.frame_ids == ("a", "b")
    first, second = (dataset.load(frame_id) for frame_id in dataset.frame_ids)
    assert float(first.metric_depth.max()) == 1.5
    assert float(second.metric_depth.min()) == 2.5
    assert first.frame.K is not None
    assert first.frame.K.tolist() == [[10, 0, 6], [0, 10, 4], [0, 0, 1]]
    assert second.frame.K is None
    (subfolders / "b" / "depth.npy").unlink()
    with pytest.raises(FileFormatError, match=r"1 frames lack .* first 'b'"):
        FrameFolder(subfolders)


def test_reads_the_real_frames(real_frames: Path) -> None:
    dataset = FrameFolder(real_frames, max_depth=20.0)
    assert {"realsense_3", "window_001", "kittidc_64l_1"} <= set(dataset.frame_ids)
    sample = dataset.load("realsense_3")
    assert sample.frame.K is not None
    assert 5 < float(sample.metric_depth.max()) <= 20
    assert dataset.load("window_001").frame.K is None


def test_reads_the_development_data(nyuv2_train: Path) -> None:
    dataset = FrameFolder(nyuv2_train)
    assert len(dataset.frame_ids) == 795
    sample = dataset.load("0169")
    assert sample.frame.image.shape == (480, 640, 3)
    assert bool(sample.metric_mask.all())
    assert 0.7 < float(sample.metric_depth.min()) < float(sample.metric_depth.max()) < 10


def test_a_data_set_can_be_sent_to_a_worker(folder: Path) -> None:
    dataset = FrameFolder(folder)
    copy = pickle.loads(pickle.dumps(dataset))
    assert torch.equal(copy.load("a").metric_depth, dataset.load("a").metric_depth)


def test_bad_input(folder: Path) -> None:
    Image.fromarray(np.ones((6, 12), np.uint16)).save(folder / "depth" / "b.png")
    with pytest.raises(SizeMismatchError, match=r"b\.png: depth has 12x6 px, its image 12x8"):
        FrameFolder(folder).load("b")
    (folder / "depth" / "b.png").unlink()
    with pytest.raises(FileFormatError, match=r"1 frames lack .* first 'b'"):
        FrameFolder(folder)
    np.save(folder / "depth" / "a.npy", np.ones((8, 12)))
    with pytest.raises(FileFormatError, match="same stem"):
        FrameFolder(folder)
    with pytest.raises(FileFormatError, match=r"rgb: no such folder"):
        FrameFolder(folder / "depth")


def test_registry(folder: Path) -> None:
    assert open_dataset("folder", folder).name == "folder"
    for name in DATASETS:
        with pytest.raises(FileFormatError, match="absent"):
            open_dataset(name, folder / "absent")
    with pytest.raises(InputError, match="'scannet' is not known; use one of nyuv2"):
        open_dataset("scannet", folder)


class Numbers:
    """Frame ids alone."""

    name = "numbers"

    def __init__(self, count: int) -> None:
        self.frame_ids = tuple(f"{index:04d}" for index in range(count))

    def load(self, frame_id: str) -> Sample:
        raise AssertionError


@given(st.integers(1, 300), st.integers(1, 300))
def test_limit_is_evenly_spaced(count: int, limit: int) -> None:
    chosen = [int(frame) for frame in select_frames(Numbers(count), limit=limit)]
    assert len(chosen) == min(limit, count)
    gaps = np.diff(chosen)
    assert gaps.size == 0 or (gaps.min() > 0 and gaps.max() - gaps.min() <= 1)
    assert abs(chosen[0] - (count - 1 - chosen[-1])) <= 1


def test_frames_file(tmp_path: Path) -> None:
    listed = tmp_path / "frames.txt"
    listed.write_text("0007\n0003\n\n0005\n")
    assert select_frames(Numbers(9), frames_file=listed) == ("0003", "0005", "0007")
    assert select_frames(Numbers(9), frames_file=listed, limit=1) == ("0005",)
    listed.write_text("0007\n0042\n")
    with pytest.raises(InputError, match=r"frames\.txt: 1 frames .* '0042'"):
        select_frames(Numbers(9), frames_file=listed)
    listed.write_text("")
    with pytest.raises(InputError, match="holds no frames"):
        select_frames(Numbers(9), frames_file=listed)
    with pytest.raises(FileFormatError, match=r"absent\.txt"):
        select_frames(Numbers(9), frames_file=tmp_path / "absent.txt")
    with pytest.raises(InputError, match="at least 1"):
        select_frames(Numbers(9), limit=0)
