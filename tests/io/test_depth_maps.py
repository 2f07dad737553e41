"""Depth files: what is written is read again, and what cannot be metric is refused."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.depth_maps import (
    read_depth,
    write_depth,
    write_saturating,
)

SIZE = (12, 17)
FLOAT_SUFFIXES = [".npy", ".tiff", ".tif", ".exr"]


def _depth(seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    depth = 0.3 + 9 * torch.rand(SIZE, generator=generator)
    return torch.where(torch.rand(SIZE, generator=generator) < 0.3, 0.0, depth)


def _save(path: Path, array: NDArray[Any]) -> Path:
    if path.suffix == ".npy":
        np.save(path, array)
    else:
        Image.fromarray(array).save(path)
    return path


def _missing(**counts: int) -> dict[str, int]:
    reasons = ("zero", "negative", "non_finite", "saturated", "beyond_limits", "beyond_max_depth")
    return dict.fromkeys(reasons, 0) | counts


@pytest.mark.parametrize("suffix", FLOAT_SUFFIXES)
def test_float_formats_keep_every_bit(tmp_path: Path, suffix: str) -> None:
    depth = _depth()
    assert write_depth(tmp_path / f"a{suffix}", depth) == 0
    back = read_depth(tmp_path / f"a{suffix}")
    assert torch.equal(back.depth, depth)
    assert torch.equal(back.valid_mask, depth > 0)
    assert back.missing["zero"] == int((depth == 0).sum())
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


@pytest.mark.parametrize("scale", [0.001, 1 / 256, 0.01])
def test_png_keeps_half_a_unit(tmp_path: Path, scale: float) -> None:
    depth = _depth()
    assert write_depth(tmp_path / "a.png", depth, output_scale=scale) == 0
    back = read_depth(tmp_path / "a.png", depth_scale=scale)
    assert torch.equal(back.valid_mask, depth > 0)
    assert float((back.depth - depth).abs().max()) <= scale / 2 + 1e-6


@settings(max_examples=30)
@given(codes=arrays(np.uint16, (3, 4), elements=st.integers(0, 65534)))
def test_png_codes_survive_reading_and_writing(
    tmp_path_factory: pytest.TempPathFactory, codes: NDArray[Any]
) -> None:
    folder = tmp_path_factory.mktemp("codes")
    for scale in (0.001, 1 / 256):
        depth = read_depth(_save(folder / "a.png", codes), depth_scale=scale).depth
        assert write_depth(folder / "b.png", depth, output_scale=scale) == 0
        assert np.array_equal(np.asarray(Image.open(folder / "b.png")), codes)


def test_depth_that_does_not_fit_is_zero_and_counted(tmp_path: Path) -> None:
    depth = torch.tensor([[1.0, 65.535, 65.536, 0.0004, 0.0, -1.0, torch.nan, torch.inf]])
    assert write_depth(tmp_path / "a.png", depth) == 5
    codes = np.asarray(Image.open(tmp_path / "a.png"))
    assert codes.tolist() == [[1000, 65535, 0, 0, 0, 0, 0, 0]]
    assert write_depth(tmp_path / "a.npy", depth) == 2
    kept = np.load(tmp_path / "a.npy")
    assert np.array_equal(kept, np.where(np.isfinite(depth.numpy()), depth.numpy(), 0))


def test_saturating_values_stay_at_the_largest_code(tmp_path: Path) -> None:
    values = torch.tensor([[0.0, 0.2, 1.0, 7.0]])
    write_saturating(tmp_path / "a.png", values, output_scale=1 / 65535)
    assert np.asarray(Image.open(tmp_path / "a.png")).tolist() == [[0, 13107, 65535, 65535]]
    write_saturating(tmp_path / "a.exr", values, output_scale=0.001)
    assert torch.equal(read_depth(tmp_path / "a.exr").depth, values)


def test_each_reason_for_missing_is_counted_once(tmp_path: Path) -> None:
    codes = np.array([[0, 1, 1500, 9000, 65534, 65535]], np.uint16)
    back = read_depth(_save(tmp_path / "a.png", codes), max_depth=8.0)
    assert back.valid_mask.tolist() == [[False, True, True, False, False, False]]
    assert back.depth[0, 2] == pytest.approx(1.5)
    missing = back.missing
    assert missing == _missing(zero=1, saturated=1, beyond_max_depth=2)

    floats = np.array([[0, -0.5, np.nan, np.inf, -np.inf, 3.0, 65535.0, 1e300, 1e-42, 0.0009]])
    back = read_depth(_save(tmp_path / "a.npy", floats))
    assert back.valid_mask.tolist() == [[False] * 5 + [True, True] + [False] * 3]
    assert back.missing == _missing(zero=1, negative=1, non_finite=3, beyond_limits=3)
    assert torch.equal(back.depth[~back.valid_mask], torch.zeros(8))


@given(
    values=arrays(np.float32, (3, 4), elements=st.floats(width=32, allow_subnormal=True)),
    max_depth=st.floats(0.01, 1e6),
)
def test_every_float_is_valid_or_missing_for_one_reason(
    tmp_path_factory: pytest.TempPathFactory, values: NDArray[Any], max_depth: float
) -> None:
    path = _save(tmp_path_factory.mktemp("floats") / "a.npy", values)
    back = read_depth(path, max_depth=max_depth)
    assert int(back.valid_mask.sum()) + sum(back.missing.values()) == values.size
    measured = back.depth[back.valid_mask].double()
    assert bool(((measured >= 0.00099999) & (measured <= 1e5)).all())
    assert not back.depth[~back.valid_mask].any()


@pytest.mark.parametrize(
    ("array", "expected"),
    [
        (np.array([[1500]], np.uint16), 1.5),
        (np.array([[1500]], np.int32), 1.5),
        (np.array([[1500]], ">u2"), 1.5),
        (np.array([[1.5]], np.float16), 1.5),
        (np.array([[1.5]], ">f8"), 1.5),
    ],
)
def test_integers_are_millimetres_and_floats_metres(
    tmp_path: Path, array: NDArray[Any], expected: float
) -> None:
    assert read_depth(_save(tmp_path / "a.npy", array)).depth.item() == pytest.approx(expected)


@pytest.mark.parametrize("shape", [(1, 1, 4, 5), (4, 5, 1), (1, 4, 5), (4, 5)])
def test_singleton_axes_are_squeezed(tmp_path: Path, shape: tuple[int, ...]) -> None:
    values = np.arange(20, dtype=np.float32)
    back = read_depth(_save(tmp_path / "a.npy", values.reshape(shape)))
    assert np.array_equal(back.depth.numpy(), values.reshape(4, 5))


def test_a_single_row_is_not_squeezed_away(tmp_path: Path) -> None:
    path = _save(tmp_path / "a.npy", np.ones((1, 1, 1, 5), np.float32))
    assert read_depth(path).depth.shape == (1, 5)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "P"])
def test_several_channels_cannot_be_metric(tmp_path: Path, mode: str) -> None:
    Image.new("RGB", (5, 4), (9, 90, 200)).convert(mode).save(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"a\.png.*several channels.*no metres"):
        read_depth(tmp_path / "a.png")


@pytest.mark.parametrize("mode", ["L", "1"])
@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_8_bits_cannot_be_metric(tmp_path: Path, mode: str, suffix: str) -> None:
    Image.new(mode, (5, 4)).save(tmp_path / f"a{suffix}")
    with pytest.raises(FileFormatError, match="256 levels of 8 bits"):
        read_depth(tmp_path / f"a{suffix}")


@pytest.mark.parametrize(
    "array",
    [
        np.arange(60.0).reshape(4, 5, 3),
        np.zeros((4, 5), np.uint8),
        np.zeros((4, 5, 3), np.uint8),
        np.zeros((4, 5), bool),
        np.zeros((4, 5), complex),
        np.zeros(7),
        np.zeros((0, 5)),
        np.array([[{"a": 1}]], dtype=object),
    ],
)
def test_arrays_that_are_no_depth(tmp_path: Path, array: NDArray[Any]) -> None:
    with pytest.raises(FileFormatError, match=r"a\.npy"):
        read_depth(_save(tmp_path / "a.npy", array))


def test_an_exr_of_colours_is_refused_and_one_with_z_is_read(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    plane = np.full((4, 5), 2.0, np.float32)
    colours = np.arange(60, dtype=np.float32).reshape(4, 5, 3)
    OpenEXR.File(header, {"RGB": colours}).write(str(tmp_path / "a.exr"))
    with pytest.raises(FileFormatError, match="channels"):
        read_depth(tmp_path / "a.exr")
    OpenEXR.File(header, {"Z": plane, "A": plane * 0}).write(str(tmp_path / "a.exr"))
    assert (read_depth(tmp_path / "a.exr").depth == 2).all()
    OpenEXR.File(header, {"Y": plane.astype(np.float16)}).write(str(tmp_path / "a.exr"))
    assert (read_depth(tmp_path / "a.exr").depth == 2).all()


@pytest.mark.parametrize("suffix", [".png", ".npy", ".tiff", ".exr"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.9])
def test_truncated_files_are_refused(
    tmp_path: Path, suffix: str, kept: float, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"a{suffix}"
    write_depth(path, _depth().repeat(20, 20))
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(path)
    assert capsys.readouterr().out == ""


def test_the_last_bytes_of_a_png_matter(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_depth(path, _depth())
    content = path.read_bytes()
    path.write_bytes(content[:-6])
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(path)
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 1
    path.write_bytes(bytes(flipped))
    with pytest.raises(FileFormatError, match="damaged"):
        read_depth(path)


def test_a_png_in_name_only(tmp_path: Path) -> None:
    Image.new("L", (5, 4)).save(tmp_path / "a.png", format="JPEG")
    with pytest.raises(FileFormatError, match="damaged, or not of its kind"):
        read_depth(tmp_path / "a.png")


def test_missing_files_folders_and_unknown_extensions(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_depth(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match="is a folder"):
        read_depth(tmp_path)
    (tmp_path / "a.mat").write_bytes(b"")
    with pytest.raises(FileFormatError, match=r"'\.mat'; use one of \.png"):
        read_depth(tmp_path / "a.mat")
    with pytest.raises(FileFormatError, match=r"'\.jpg'; use one of \.png"):
        write_depth(tmp_path / "a.jpg", _depth())


def test_bombs_are_refused_by_their_header(tmp_path: Path) -> None:
    for width in (20_000, 60_000):  # below and above Pillow's own limit
        header = struct.pack(">IIBBBBB", width, 6000, 16, 0, 0, 0, 0)
        chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
        content = b"".join(
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in chunks
        )
        (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + content)
        with pytest.raises(FileFormatError, match=r"megapixels|bomb"):
            read_depth(tmp_path / "a.png")
    with (tmp_path / "a.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f4", "fortran_order": False, "shape": (20_000, 6000)}
        )
        file.truncate(file.tell() + 4 * 20_000 * 6000)
    with pytest.raises(FileFormatError, match="megapixels"):
        read_depth(tmp_path / "a.npy")


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_scales_and_limits_are_positive(tmp_path: Path, bad: float) -> None:
    path = tmp_path / "a.png"
    write_depth(path, _depth())
    with pytest.raises(InputError, match="depth_scale"):
        read_depth(path, depth_scale=bad)
    with pytest.raises(InputError, match="max_depth"):
        read_depth(path, max_depth=bad)
    with pytest.raises(InputError, match="output_scale"):
        write_depth(path, _depth(), output_scale=bad)


def test_a_scale_the_wrong_way_round_writes_no_empty_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no depth fits.*`output_scale`"):
        write_depth(tmp_path / "a.png", _depth(), output_scale=1000.0)
    assert not list(tmp_path.iterdir())
    assert write_depth(tmp_path / "a.png", torch.zeros(SIZE), output_scale=1000.0) == 0


def test_real_frames(real_frames: Path) -> None:
    kitti = read_depth(real_frames / "kitti_vis_000000" / "depth.png", depth_scale=1 / 256)
    assert 1 < float(kitti.depth[kitti.valid_mask].median()) < 80
    void = read_depth(real_frames / "void_150_1" / "depth.npy")
    assert void.depth.shape == (480, 640)
    assert int(void.valid_mask.sum()) == np.count_nonzero(
        np.load(real_frames / "void_150_1" / "depth.npy")
    )
    far = read_depth(real_frames / "realsense_3" / "depth.png", max_depth=10.0)
    assert far.missing["beyond_max_depth"] > 0
    assert float(far.depth.max()) <= 10
