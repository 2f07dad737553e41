"""Depth in every container: written here byte by byte from the format's definition, then read."""

import csv
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.depth_files import is_depth_name, load_depth_file, split_member
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.heif import heif_metres

CODES = np.random.default_rng(0).integers(1, 9000, (6, 9), dtype=np.uint16)
METRES = CODES.astype(np.float32) * np.float32(0.001)


def _close(path: str | Path, **arguments: Any) -> bool:
    depth = read_depth(path, **arguments).depth.numpy()
    return depth.shape == METRES.shape and bool(np.allclose(depth, METRES, rtol=1e-6))


def test_pgm_is_big_endian_or_text(tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P5\n# depth\n9 6\n65535\n" + CODES.astype(">u2").tobytes())
    assert _close(tmp_path / "a.pgm")
    (tmp_path / "a.pgm").write_bytes(b"P5 9 6 9999\n" + CODES.astype(">u2").tobytes())
    assert _close(tmp_path / "a.pgm")
    text = "\n".join(" ".join(map(str, row)) for row in CODES)
    (tmp_path / "a.pgm").write_text(f"P2\n9 6\n65535\n{text}\n")
    assert _close(tmp_path / "a.pgm")


@pytest.mark.parametrize(
    "content",
    [b"", b"P5\n9 6\n65535\n123", b"P4\n9 6\n", b"P5\n9 6\n70000\n", b"P2\n1 1\n9000\n9001\n"],
)
def test_damaged_pgm(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.pgm").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"a\.pgm"):
        read_depth(tmp_path / "a.pgm")


def test_a_pgm_of_8_bits_is_no_depth(tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P5\n3 1\n255\nabc")
    with pytest.raises(FileFormatError, match="256 levels"):
        read_depth(tmp_path / "a.pgm")


@pytest.mark.parametrize(("kind", "scale"), [("<f4", "-1.0"), (">f4", "1.0")])
def test_pfm_has_its_lowest_row_first(tmp_path: Path, kind: str, scale: str) -> None:
    body = METRES[::-1].astype(kind).tobytes()
    (tmp_path / "a.pfm").write_bytes(f"Pf\n9 6\n{scale}\n".encode() + body)
    assert _close(tmp_path / "a.pfm")
    three = np.repeat(METRES[::-1, :, None], 3, axis=2).astype(kind).tobytes()
    (tmp_path / "a.pfm").write_bytes(f"PF\n9 6\n{scale}\n".encode() + three)
    assert _close(tmp_path / "a.pfm")
    assert [note.kind for note in read_depth(tmp_path / "a.pfm").notes] == ["equal_channels"]
    (tmp_path / "a.pfm").write_bytes(f"Pf\n9 6\n{scale}\n".encode() + body[:-1])
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(tmp_path / "a.pfm")


def test_npz_and_its_members(tmp_path: Path) -> None:
    np.savez(tmp_path / "one.npz", METRES[None])
    assert _close(tmp_path / "one.npz")
    np.savez(tmp_path / "two.npz", depth=CODES, image=np.zeros((6, 9, 3)))
    assert _close(f"{tmp_path / 'two.npz'}:depth")
    with pytest.raises(FileFormatError, match=r"several arrays.*two\.npz:NAME, of depth, image"):
        read_depth(tmp_path / "two.npz")
    with pytest.raises(FileFormatError, match="no array depths"):
        read_depth(f"{tmp_path / 'two.npz'}:depths")
    (tmp_path / "two.npz").write_bytes(b"PK")
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(tmp_path / "two.npz")
    np.savez(tmp_path / "evil.npz", np.array([[{}]], object))
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(tmp_path / "evil.npz")


def test_hdf5_and_its_members(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["frames/depth"] = CODES
    assert _close(tmp_path / "a.h5")
    assert _close(f"{tmp_path / 'a.h5'}:frames/depth")
    assert _close(f"{tmp_path / 'a.h5'}:/frames/depth")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["rgb"] = np.zeros((6, 9, 3))
    with pytest.raises(FileFormatError, match="frames/depth, rgb"):
        read_depth(tmp_path / "a.h5")
    (tmp_path / "a.hdf5").write_bytes(b"\x89HDF")
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(tmp_path / "a.hdf5")


def test_member_names_do_not_confuse_drives_and_folders(tmp_path: Path) -> None:
    assert split_member("C:/a.h5:x/y") == (Path("C:/a.h5"), "x/y")
    assert split_member("a.npz") == (Path("a.npz"), None)
    assert split_member("frame:1.png") == (Path("frame:1.png"), None)
    with pytest.raises(FileFormatError, match="no such file"):
        load_depth_file(f"{tmp_path}/a.h5:depth")


def _realsense_metadata(path: Path, kind: str = "Z16") -> None:
    """As the viewer writes it beside a snapshot."""
    path.write_text(
        f"Frame Info: \nType,Depth\nFormat,{kind}\nFrame Number,12\nTimestamp (ms),1700.25\n"
        "Resolution x,9\nResolution y,6\nBytes per pixel,2\n\n"
        "Intrinsic:,\nFx,380.5\nFy,380.5\nPPx,4.5\nPPy,3.5\nDistorsion,Brown Conrady\n"
    )


@pytest.mark.parametrize("mark", ["_", "-"])
def test_raw_of_the_realsense_viewer(tmp_path: Path, mark: str) -> None:
    raw = tmp_path / "shot_Depth.raw"
    raw.write_bytes(CODES.astype("<u2").tobytes())
    with pytest.raises(FileFormatError, match=r"put shot_Depth_metadata\.csv beside it"):
        read_depth(raw)
    metadata = tmp_path / f"shot_Depth{mark}metadata.csv"
    _realsense_metadata(metadata)
    assert _close(raw)
    raw.write_bytes(CODES.tobytes()[:-2])
    with pytest.raises(FileFormatError, match=r"106 bytes.*9x6"):
        read_depth(raw)
    _realsense_metadata(metadata, "Y16")
    with pytest.raises(FileFormatError, match="holds Y16"):
        read_depth(raw)
    assert is_depth_name(raw)
    assert not is_depth_name(metadata)


def test_csv_in_metres_and_in_millimetres(tmp_path: Path) -> None:
    for name, values in (("m", METRES), ("mm", CODES)):
        with (tmp_path / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows(values.tolist())
        assert _close(tmp_path / f"{name}.csv")
    (tmp_path / "a.csv").write_text("1,2,\n3,4,\n")  # a comma ends each line
    assert read_depth(tmp_path / "a.csv").depth.shape == (2, 2)
    for text in ("", "1,2\n3\n", "a,b\n1,2\n"):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(FileFormatError, match=r"a\.csv"):
            read_depth(tmp_path / "a.csv")


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_equal_channels_are_one(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    for channels in (3, 4):
        deep = np.repeat(CODES[..., None], channels, axis=2)
        deep[..., 3:] = 65535
        cv2.imwrite(str(path), deep)
        assert _close(path)
        assert [note.kind for note in read_depth(path).notes] == ["equal_channels"]
    deep[0, 0, 0] += 1
    cv2.imwrite(str(path), deep)
    with pytest.raises(FileFormatError, match="several channels"):
        read_depth(path)
    Image.fromarray(np.repeat((CODES // 64)[..., None], 3, axis=2).astype(np.uint8)).save(path)
    with pytest.raises(FileFormatError, match="several channels"):
        read_depth(path)


def test_an_exr_of_equal_colours(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with_hole = METRES.copy()
    with_hole[0, 0] = np.nan
    grey = np.repeat(with_hole[..., None], 3, axis=2)
    OpenEXR.File(header, {"RGB": grey}).write(str(tmp_path / "a.exr"))
    back = read_depth(tmp_path / "a.exr")
    assert np.allclose(back.depth.numpy()[1:], METRES[1:])
    assert back.missing["non_finite"] == 1
    assert [note.kind for note in back.notes] == ["equal_channels"]


def test_heic_without_depth_is_refused(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.from_pillow(Image.new("RGB", (64, 64))).save(tmp_path / "a.heic")
    with pytest.raises(FileFormatError, match="holds no depth map"):
        read_depth(tmp_path / "a.heic")


def test_heic_depth_needs_limits_in_metres() -> None:
    codes = np.array([[0, 255]], np.uint8)

    def metres(**metadata: Any) -> Any:
        values: NDArray[np.float32] = heif_metres(Path("a.heic"), codes, metadata)
        return pytest.approx(values[0].tolist())

    assert metres(representation_type=2, z_near=0.5, z_far=4.5) == [0.5, 4.5]
    assert metres(representation_type=0, d_min=0.25, d_max=2.0) == [4.0, 0.5]
    assert metres(representation_type=0, z_near=0.5, z_far=4.0) == [4.0, 0.5]
    for relative in ({}, {"representation_type": 1, "d_min": 0.0, "d_max": 1.0}):
        with pytest.raises(FileFormatError, match="relative"):
            metres(**relative)
