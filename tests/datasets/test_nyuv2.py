import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from steered_marigold.datasets.nyuv2 import Nyuv2, Nyuv2H5, split_indices
from steered_marigold.errors import (
    FileFormatError,
    InputError,
    MissingExtraError,
    SizeMismatchError,
)


def picture(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A frame as one sees it: image [480, 640, 3], raw depth with holes and dense depth [m]."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (480, 640, 3), dtype=np.uint8)
    dense = rng.uniform(0.7, 9.9, (480, 640)).astype(np.float32)
    return image, np.where(rng.random((480, 640)) < 0.2, 0, dense).astype(np.float32), dense


@pytest.fixture(scope="module")
def mat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The official layout: MATLAB 7.3 is HDF5 behind a 512-byte header, columns first.

    Chunks that are never written take no space, so only two of the 1449 frames do.
    """
    path = tmp_path_factory.mktemp("nyuv2") / "nyu_depth_v2_labeled.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("images", (1449, 3, 640, 480), np.uint8, chunks=(1, 3, 640, 480))
        for key in ("depths", "rawDepths"):
            file.create_dataset(key, (1449, 640, 480), np.float32, chunks=(1, 640, 480))
        for index in (0, 2):
            image, raw, dense = picture(index)
            file["images"][index] = image.transpose(2, 1, 0)
            file["rawDepths"][index] = raw.T
            file["depths"][index] = dense.T
    return path


def test_official_split() -> None:
    test, train = split_indices("test"), split_indices("train")
    assert (len(test), len(train)) == (654, 795)
    assert sorted(test + train) == list(range(1449)) == list(split_indices("all"))
    # the first frames of the toolbox's testNdxs (1, 2, 9, 14, 15) and trainNdxs (3, 4, 5), from 0
    assert test[:5] == (0, 1, 8, 13, 14)
    assert train[:3] == (2, 3, 4)


def test_train_split_is_the_development_data(nyuv2_train: Path) -> None:
    names = {int(path.stem) for path in (nyuv2_train / "depth").iterdir()}
    assert names == set(split_indices("train"))


def test_raw_depth_by_default_in_official_orientation(mat: Path) -> None:
    dataset = Nyuv2(mat)
    assert len(dataset.frame_ids) == 654
    sample = dataset.load("0000")
    image, raw, _ = picture(0)
    assert sample.frame.image.numpy().tobytes() == image.tobytes()
    np.testing.assert_array_equal(sample.metric_depth.numpy(), raw)
    np.testing.assert_array_equal(sample.metric_mask.numpy(), raw > 0)
    assert sample.frame.K is not None
    assert not sample.frame.measured


def test_inpainted_depth_and_train_split(mat: Path) -> None:
    dataset = Nyuv2(mat, split="train", ground_truth="inpainted")
    assert dataset.frame_ids[0] == "0002"
    sample = dataset.load("0002")
    np.testing.assert_array_equal(sample.metric_depth.numpy(), picture(2)[2])
    assert bool(sample.metric_mask.all())


def test_a_missing_file_names_itself_and_its_source(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"absent\.mat.*horatio\.cs\.nyu\.edu"):
        Nyuv2(tmp_path / "absent.mat")


def test_a_damaged_file_names_itself_and_its_source(mat: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mat"
    cut.write_bytes(mat.read_bytes()[:4000])
    with pytest.raises(FileFormatError, match=r"cut\.mat.*horatio\.cs\.nyu\.edu"):
        Nyuv2(cut)


def test_another_hdf5_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.mat"
    with h5py.File(path, "w") as file:
        file["images"] = np.zeros((2, 3, 640, 480), np.uint8)
    with pytest.raises(FileFormatError, match="rawDepths"):
        Nyuv2(path)
    with h5py.File(path, "a") as file:
        file["rawDepths"] = np.zeros((2, 640, 480), np.float32)
    with pytest.raises(FileFormatError, match="1449 frames"):
        Nyuv2(path)


def test_unknown_choices(mat: Path) -> None:
    with pytest.raises(InputError, match="split 'val'"):
        Nyuv2(mat, split="val")
    with pytest.raises(InputError, match="ground truth 'filled'"):
        Nyuv2(mat, ground_truth="filled")


def test_without_h5py_one_line_says_what_to_install(
    mat: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'steered-marigold\[eval\]'"):
        Nyuv2(mat)


def write_h5(path: Path, image: np.ndarray, depth: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file["rgb"] = image.transpose(2, 0, 1)
        file["depth"] = depth


def test_h5_folders(tmp_path: Path) -> None:
    image, raw, _ = picture(1)
    raw[3, 4] = np.nan
    write_h5(tmp_path / "val" / "official" / "00002.h5", image, raw)
    write_h5(tmp_path / "val" / "official" / "00001.h5", image[::-1], raw[::-1])
    dataset = Nyuv2H5(tmp_path / "val")
    assert dataset.frame_ids == ("official/00001", "official/00002")
    sample = dataset.load("official/00002")
    np.testing.assert_array_equal(sample.frame.image.numpy(), image)
    np.testing.assert_array_equal(sample.metric_mask.numpy(), np.nan_to_num(raw) > 0)
    assert bool(torch.isfinite(sample.metric_depth).all())


def test_h5_bad_input(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"holds no \.h5 file"):
        Nyuv2H5(tmp_path)
    image, raw, _ = picture(1)
    write_h5(tmp_path / "small.h5", image, raw[:240])
    (tmp_path / "broken.h5").write_bytes(b"not HDF5")
    dataset = Nyuv2H5(tmp_path)
    with pytest.raises(SizeMismatchError, match=r"small\.h5: depth has 640x240 px.*640x480"):
        dataset.load("small")
    with pytest.raises(FileFormatError, match=r"broken\.h5"):
        dataset.load("broken")
