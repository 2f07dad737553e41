"""Frames that a visitor may open, and those that not."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from steered_marigold.app.inputs import SAMPLES, Disk, checked_frame, depth_file, sample, stored_as
from steered_marigold.errors import InputError, NoMeasurementsError
from steered_marigold.frames.sources import FrameFiles, Reading
from steered_marigold.io.depth_maps import write_depth


def write_frame(folder: Path, name: str, size: tuple[int, int] = (12, 16)) -> FrameFiles:
    """An image and depth of 1 to 2 m, a third of it missing, as millimetres."""
    for part in ("images", "depths"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    image, depth = folder / "images" / f"{name}.png", folder / "depths" / f"{name}.png"
    codes = np.linspace(1000, 2000, size[0] * size[1]).reshape(size).astype(np.uint16)
    codes[: size[0] // 3] = 0
    Image.fromarray(np.full((*size, 3), 128, np.uint8)).save(image)
    Image.fromarray(codes).save(depth)
    return FrameFiles(image=image, depth=depth)


@pytest.mark.parametrize("name", SAMPLES)
def test_every_sample_is_a_frame_with_its_camera_and_holes(name: str) -> None:
    files, reading = sample(name)
    frame = checked_frame(files, reading, most_megapixels=1.0)
    assert frame.size == (480, 640)
    assert frame.K is not None
    assert 0.05 < float(frame.valid_mask.float().mean()) < 0.9
    assert not frame.notices


def test_the_samples_are_small() -> None:
    added = [folder for folder in SAMPLES.values() if folder.name != "sample"]
    assert sum(file.stat().st_size for folder in added for file in folder.iterdir()) < 300_000


@pytest.mark.parametrize(
    ("reading", "said"),
    [
        (Reading(), "uint16, 1.3 to 2.0 m if millimetres; 66.7% of the pixels measured."),
        (Reading(depth_scale=0.01), "uint16, 13.4 to 20.0 m if one unit is 0.01 m; 66.7%"),
        (Reading(depth_encoding="tum"), "uint16, 0.3 to 0.4 m if encoded as tum; 66.7%"),
    ],
)
def test_says_what_the_numbers_were_taken_for(tmp_path: Path, reading: Reading, said: str) -> None:
    files = write_frame(tmp_path, "a")
    frame = checked_frame(files, reading, most_megapixels=1.0)
    assert stored_as(files.depth, frame, reading).startswith(said)


def test_floats_are_taken_for_metres(tmp_path: Path) -> None:
    files = write_frame(tmp_path, "a")
    frame = checked_frame(files, Reading(), most_megapixels=1.0)
    write_depth(tmp_path / "a.npy", frame.sparse_depth)
    assert stored_as(tmp_path / "a.npy", frame, Reading()).startswith("float32, 1.3 to 2.0 m if m")


def test_large_images_are_refused_by_their_header(tmp_path: Path) -> None:
    files = write_frame(tmp_path, "a", (100, 120))
    checked_frame(files, Reading(), most_megapixels=0.012)
    with pytest.raises(InputError, match=r"0.0 megapixels; this page takes up to 0.0119"):
        checked_frame(files, Reading(), most_megapixels=0.0119)


def test_metadata_is_no_depth() -> None:
    assert depth_file([Path("a_metadata.csv"), Path("a.raw")]) == Path("a.raw")
    assert depth_file([Path("a.txt")]) is None


def test_folders_of_the_server_are_listed_paired_and_opened(tmp_path: Path) -> None:
    files = write_frame(tmp_path / "kitchen", "f1")
    write_frame(tmp_path / ".hidden", "f2")
    disk = Disk(root=tmp_path)
    assert disk.images() == ["kitchen/depths", "kitchen/images"]  # both hold .png
    assert "kitchen/depths" in disk.depths()
    assert disk.frames("kitchen/images", "kitchen/depths") == ["f1"]
    assert disk.files("kitchen/images", "kitchen/depths", "f1") == files
    with pytest.raises(InputError, match="has no frame f9"):
        disk.files("kitchen/images", "kitchen/depths", "f9")


@pytest.mark.parametrize("name", ["..", "/etc", "kitchen/../../x", "link", "nothing"])
def test_nothing_outside_the_root_can_be_opened(tmp_path: Path, name: str) -> None:
    root = tmp_path / "root"
    write_frame(root / "kitchen", "f1")
    write_frame(tmp_path / "x", "secret")
    (root / "link").symlink_to(tmp_path / "x" / "images")
    with pytest.raises(InputError, match="is not in the folder"):
        Disk(root=root).frames(name, None)


def test_a_recording_of_the_server_is_opened_frame_by_frame(tmp_path: Path) -> None:
    from tests.io.bags.building import builder_for, camera_entries, write_bag

    write_bag(tmp_path / "walk.bag", "ros1", camera_entries(builder_for("ros1"), 3))
    disk = Disk(root=tmp_path)
    assert disk.images() == ["walk.bag"]
    assert disk.frames("walk.bag", None) == ["0", "1", "2"]
    assert disk.files("walk.bag", None, "1") is None
    first, second = (disk.recorded("walk.bag", i, most_megapixels=1.0) for i in (0, 1))
    assert first.measured
    assert second.stamp is not None
    assert first.stamp is not None
    assert second.stamp > first.stamp
    with pytest.raises(InputError, match="has no frame 3"):
        disk.recorded("walk.bag", 3, most_megapixels=1.0)


def test_a_map_without_measurements_is_the_packages_error(tmp_path: Path) -> None:
    files = write_frame(tmp_path, "a")
    Image.fromarray(np.zeros((12, 16), np.uint16)).save(tmp_path / "depths" / "a.png")
    with pytest.raises(NoMeasurementsError):
        checked_frame(files, Reading(), most_megapixels=1.0)
