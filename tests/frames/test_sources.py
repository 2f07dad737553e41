"""Frames from files and folders, checked against each other."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source, read_frame
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.intrinsics import read_intrinsics

Files = tuple[Path, Path]


def test_a_frame_is_what_its_files_hold(frame_files: Files) -> None:
    image, depth = frame_files
    reading = Reading(intrinsics=read_intrinsics("30,30,16,12"))
    frame = read_frame(FrameFiles(image=image, depth=depth), reading)
    measured = read_depth(depth)
    assert frame.id == "image"
    assert np.array_equal(frame.image, np.array(Image.open(image)))
    assert torch.equal(frame.sparse_depth, measured.depth)
    assert torch.equal(frame.valid_mask, measured.valid_mask)
    assert frame.K is not None
    assert frame.K.tolist() == [[30, 0, 16], [0, 30, 12], [0, 0, 1]]
    assert frame.missing["zero"] == int((~measured.valid_mask).sum())
    assert frame.confidence is None


def test_distortion_that_stays_is_said(frame_files: Files) -> None:
    image, depth = frame_files
    files = FrameFiles(image=image, depth=depth)
    lens = replace(read_intrinsics("30,30,16,12"), distortion=(0.1, 0.0, 0.0, 0.0))
    for undistort in (False, True):
        frame = read_frame(files, Reading(intrinsics=lens, undistort=undistort))
        kinds = [notice.kind for notice in frame.notices]
        assert ("distorted" in kinds) is not undistort


def test_confidence_has_the_size_of_the_depth_map(frame_files: Files, tmp_path: Path) -> None:
    image, depth = frame_files
    codes = np.full((24, 32), 255, np.uint8)
    codes[:, :16] = 0
    confidence = tmp_path / "confidence.png"
    Image.fromarray(codes).save(confidence)
    files = FrameFiles(image=image, depth=depth, confidence=confidence)
    frame = read_frame(files, Reading())
    assert frame.confidence is not None
    assert np.array_equal(frame.confidence, codes / 255)

    Image.fromarray(0 * codes).save(confidence)
    with pytest.raises(NoMeasurementsError, match=r"confidence\.png: is 0 wherever"):
        read_frame(files, Reading())

    Image.fromarray(codes[:-1]).save(confidence)
    with pytest.raises(SizeMismatchError, match=r"32x23 but .* 32x24"):
        read_frame(files, Reading())


def test_a_registered_depth_map_moves_to_the_grid_of_the_image(
    frame_files: Files, tmp_path: Path
) -> None:
    image, depth = frame_files
    Image.open(image).resize((96, 72)).save(image)
    confidence = torch.rand(24, 32, generator=torch.Generator().manual_seed(0)).numpy()
    np.save(tmp_path / "confidence.npy", confidence)
    files = FrameFiles(image=image, depth=depth, confidence=tmp_path / "confidence.npy")
    with pytest.raises(SizeMismatchError, match=r"96x72.*32x24.*`depth_grid=registered`"):
        read_frame(files, Reading())
    frame = read_frame(files, Reading(registered=True))
    centres = (slice(1, None, 3), slice(1, None, 3))
    measured = read_depth(depth)
    assert torch.equal(frame.sparse_depth[centres], measured.depth)
    assert int(frame.valid_mask.sum()) == int(measured.valid_mask.sum())
    assert frame.confidence is not None
    kept = frame.confidence[centres][measured.valid_mask]
    assert np.array_equal(kept, confidence[measured.valid_mask.numpy()])
    Image.open(image).resize((96, 96)).save(image)
    with pytest.raises(SizeMismatchError, match="aspect ratio"):
        read_frame(files, Reading(registered=True))


def test_an_exif_orientation_must_fit_the_depth(frame_files: Files) -> None:
    image, depth = frame_files
    picture = Image.open(image)
    upright = np.array(picture)
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(image, exif=exif)
    files = FrameFiles(image=image, depth=depth)
    with pytest.raises(SizeMismatchError, match=r"24x32 but .* 32x24.*EXIF"):
        read_frame(files, Reading())
    Image.fromarray(np.rot90(upright)).save(image, exif=exif)
    assert np.array_equal(read_frame(files, Reading()).image, upright)


def test_nothing_measured(frame_files: Files) -> None:
    image, depth = frame_files
    Image.fromarray(np.full((24, 32), 65535, np.uint16)).save(depth)
    files = FrameFiles(image=image, depth=depth)
    with pytest.raises(NoMeasurementsError, match=r"no valid pixel.*768 saturated.*`no_meas"):
        read_frame(files, Reading())
    for given in (files, FrameFiles(image=image)):
        frame = read_frame(given, Reading(no_measurements=True))
        assert not frame.measured
        assert not frame.sparse_depth.any()
        assert np.array_equal(frame.image, np.array(Image.open(image)))


@pytest.mark.parametrize("metres", [0.002, 900.0])
def test_an_implausible_scale_is_a_notice(frame_files: Files, metres: float) -> None:
    image, depth = frame_files
    files = FrameFiles(image=image, depth=depth)
    assert read_frame(files, Reading()).notices == ()
    notices = read_frame(files, Reading(depth_scale=metres / 2700)).notices
    assert [notice.kind for notice in notices] == ["implausible_scale"]
    assert "`depth_scale`" in notices[0].text


@pytest.mark.parametrize("name", ["depth_scale", "max_depth"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_readings_that_cannot_be_meant(frame_files: Files, name: str, value: float) -> None:
    image, depth = frame_files
    changes: dict[str, Any] = {name: value}
    with pytest.raises(InputError, match=f"`{name}` must be a positive number"):
        read_frame(FrameFiles(image=image, depth=depth), Reading(**changes))


def test_one_file_is_not_both(frame_files: Files) -> None:
    _, depth = frame_files
    with pytest.raises(InputError, match="given as the image and as its depth map"):
        read_frame(FrameFiles(image=depth, depth=depth), Reading())


def test_folders_are_frames_by_stem(frame_folders: Files, tmp_path: Path) -> None:
    images, depths = frame_folders
    Image.new("RGB", (32, 24)).save(images / "0003.png")  # without depth
    (images / ".hidden.png").write_text("x")
    (images / "notes.txt").write_text("x")
    source = folder_source(FrameFiles(image=images, depth=depths), Reading())
    assert source.ids == ["0000", "0001", "0002"]
    assert source.lone == (images / "0003.png",)
    copy = pickle.loads(pickle.dumps(source))  # workers share it
    for stem in source.ids:
        files = FrameFiles(image=images / f"{stem}.png", depth=depths / f"{stem}.png")
        expected = read_frame(files, Reading())
        for frame in (source.load(stem), copy.load(stem)):
            assert_same(frame, expected)

    weights = tmp_path / "weights"
    weights.mkdir()
    for stem in ("0000", "0002"):
        np.save(weights / f"{stem}.npy", np.full((24, 32), 0.5, np.float32))
    files = FrameFiles(image=images, depth=depths, confidence=weights)
    weighted = folder_source(files, Reading())
    assert weighted.ids == ["0000", "0002"]
    assert images / "0001.png" in weighted.lone
    confidence = weighted.load("0002").confidence
    assert confidence is not None
    assert set(confidence.flatten().tolist()) == {0.5}


def assert_same(frame: Frame, expected: Frame) -> None:
    """Frames of equal id and pixels."""
    assert frame.id == expected.id
    for name in ("image", "sparse_depth", "valid_mask"):
        assert torch.equal(getattr(frame, name), getattr(expected, name))


def test_folders_of_images_alone(frame_folders: Files) -> None:
    source = folder_source(FrameFiles(image=frame_folders[0]), Reading(no_measurements=True))
    assert source.ids == ["0000", "0001", "0002"]
    assert not source.load("0001").measured


def test_images_of_several_kinds_have_ids_of_their_own(frame_folders: Files) -> None:
    images, _ = frame_folders
    Image.new("RGB", (32, 24)).save(images / "0000.5.JPG")
    alone = FrameFiles(image=images)
    files = folder_source(alone, Reading(no_measurements=True)).files
    assert list(files) == ["0000.5", "0000", "0001", "0002"]  # in the order of the names
    assert [files[i].image.name for i in files] == [
        "0000.5.JPG",
        *(f"000{i}.png" for i in range(3)),
    ]
    assert "0000.6" not in files
    Image.new("RGB", (32, 24)).save(images / "0001.jpg")
    with pytest.raises(InputError, match=r"0001\.png: another image is named 0001, too"):
        folder_source(alone, Reading(no_measurements=True))


def test_folders_that_make_no_frames(frame_folders: Files, tmp_path: Path) -> None:
    images, depths = frame_folders
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no depth maps were found to pair"):
        folder_source(FrameFiles(image=images, depth=tmp_path / "empty"), Reading())
    with pytest.raises(InputError, match="must be one too"):
        folder_source(FrameFiles(image=images, depth=depths / "0000.png"), Reading())
    with pytest.raises(InputError, match="empty: holds no images"):
        folder_source(FrameFiles(image=tmp_path / "empty"), Reading(no_measurements=True))
