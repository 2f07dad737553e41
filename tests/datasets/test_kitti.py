from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from steered_marigold.datasets.kitti import KittiSelection
from steered_marigold.errors import FileFormatError, SizeMismatchError

FRAME = "2011_09_26_drive_0002_sync_{}_0000000005_image_02"
SIZE = (352, 1216)


@pytest.fixture
def selection(tmp_path: Path) -> Path:
    """One frame in the layout of val_selection_cropped."""
    rng = np.random.default_rng(0)
    for folder in ("image", "velodyne_raw", "groundtruth_depth", "intrinsics"):
        (tmp_path / folder).mkdir()
    Image.fromarray(rng.integers(0, 256, (*SIZE, 3), dtype=np.uint8)).save(
        tmp_path / "image" / f"{FRAME.format('image')}.png"
    )
    for folder, share in (("velodyne_raw", 0.05), ("groundtruth_depth", 0.2)):
        codes = rng.integers(1, 80 * 256, SIZE) * (rng.random(SIZE) < share)
        Image.fromarray(codes.astype(np.uint16)).save(
            tmp_path / folder / f"{FRAME.format(folder)}.png"
        )
    (tmp_path / "intrinsics" / f"{FRAME.format('image')}.txt").write_text(
        "721.5377 0.000000 596.5593 0.000000 721.5377 149.854 0.000000 0.000000 1.000000 \n"
    )
    return tmp_path


def test_reads_metres_scan_and_intrinsics(selection: Path) -> None:
    dataset = KittiSelection(selection)
    assert dataset.frame_ids == (FRAME.format("image"),)
    sample = dataset.load(dataset.frame_ids[0])
    assert sample.frame.K is not None
    for folder, depth, mask in (
        ("groundtruth_depth", sample.metric_depth, sample.metric_mask),
        ("velodyne_raw", sample.frame.sparse_depth, sample.frame.valid_mask),
    ):
        with Image.open(selection / folder / f"{FRAME.format(folder)}.png") as file:
            codes = np.asarray(file)
        np.testing.assert_allclose(depth.numpy(), codes / 256, rtol=1e-6)
        np.testing.assert_array_equal(mask.numpy(), codes > 0)
    assert sample.frame.K[0].tolist() == pytest.approx([721.5377, 0, 596.5593])


def test_bad_input(selection: Path, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such folder"):
        KittiSelection(tmp_path / "absent")
    empty = tmp_path / "empty"
    (empty / "image").mkdir(parents=True)
    with pytest.raises(FileFormatError, match=r"holds no frames.*cvlibs\.net"):
        KittiSelection(empty)
    scan = selection / "velodyne_raw" / f"{FRAME.format('velodyne_raw')}.png"
    Image.fromarray(np.ones((10, 20), np.uint16)).save(scan)
    dataset = KittiSelection(selection)
    with pytest.raises(SizeMismatchError, match="20x10 px, its image 1216x352"):
        dataset.load(dataset.frame_ids[0])
    scan.unlink()
    with pytest.raises(FileFormatError, match=r"velodyne_raw.*no such file"):
        dataset.load(dataset.frame_ids[0])
