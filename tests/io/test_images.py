"""Images of every kind become 8-bit RGB."""

import io
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.images import read_image

COLOURS = np.random.default_rng(0).integers(0, 256, (6, 9, 3), dtype=np.uint8)
GREY = COLOURS[..., 0]


def _read(tmp_path: Path, picture: Image.Image, name: str = "a.png") -> np.ndarray:
    picture.save(tmp_path / name)
    return read_image(tmp_path / name).pixels.numpy()


@pytest.mark.parametrize("name", ["a.png", "a.bmp", "a.tiff", "a.ppm"])
def test_rgb_is_read_as_it_is(tmp_path: Path, name: str) -> None:
    assert np.array_equal(_read(tmp_path, Image.fromarray(COLOURS), name), COLOURS)


def test_alpha_is_dropped(tmp_path: Path) -> None:
    alpha = np.dstack([COLOURS, GREY])
    assert np.array_equal(_read(tmp_path, Image.fromarray(alpha, "RGBA")), COLOURS)


def test_grey_becomes_three_channels(tmp_path: Path) -> None:
    expected = np.repeat(GREY[..., None], 3, axis=2)
    assert np.array_equal(_read(tmp_path, Image.fromarray(GREY)), expected)
    with_alpha = Image.fromarray(np.dstack([GREY, GREY]), "LA")
    assert np.array_equal(_read(tmp_path, with_alpha), expected)


def test_palettes_are_looked_up(tmp_path: Path) -> None:
    picture = Image.fromarray(GREY // 64).convert("P")
    picture.putpalette([10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120])
    expected = np.array(picture.getpalette(), np.uint8).reshape(-1, 3)[GREY // 64]
    assert np.array_equal(_read(tmp_path, picture), expected)
    picture.save(tmp_path / "b.png", transparency=1)
    assert np.array_equal(read_image(tmp_path / "b.png").pixels.numpy(), expected)


def test_bilevel_images(tmp_path: Path) -> None:
    image = _read(tmp_path, Image.fromarray(GREY > 128))
    assert np.array_equal(image[..., 0], np.where(GREY > 128, 255, 0))


def _save_deep_colour(path: Path, deep: NDArray[Any]) -> None:
    """16 bits a channel; a .ppm is written from its definition."""
    if path.suffix == ".ppm":
        header = f"P6\n# written by a test\n{deep.shape[1]} {deep.shape[0]}\n65535\n"
        path.write_bytes(header.encode() + deep.astype(">u2").tobytes())
    else:
        cv2.imwrite(str(path), deep[..., ::-1])


def test_16_bit_colour_keeps_its_high_byte(tmp_path: Path) -> None:
    deep = COLOURS.astype(np.uint16) * 257
    for name in ("a.png", "a.tiff", "a.ppm"):
        _save_deep_colour(tmp_path / name, deep)
        assert np.array_equal(read_image(tmp_path / name).pixels.numpy(), COLOURS)


@pytest.mark.parametrize("brightest", [1023, 65535])
@pytest.mark.parametrize("name", ["a.png", "a.tiff"])
def test_infrared_of_any_range_uses_all_of_8_bits(
    tmp_path: Path, brightest: int, name: str
) -> None:
    ramp = np.linspace(0, brightest, 4000).astype(np.uint16).reshape(40, 100)
    image = _read(tmp_path, Image.fromarray(ramp), name).astype(int)
    assert (image[0, 0, 0], image[-1, -1, 0]) == (0, 255)
    assert (image[..., 0] == image[..., 2]).all()
    assert np.abs(image[..., 0] - np.linspace(0, 255, 4000).reshape(40, 100)).max() < 2


def test_a_black_infrared_image_stays_black(tmp_path: Path) -> None:
    assert not _read(tmp_path, Image.fromarray(np.zeros((4, 5), np.uint16))).any()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path: Path, orientation: int) -> None:
    picture = Image.fromarray(COLOURS)
    exif = picture.getexif()
    exif[0x0112] = orientation
    picture.save(tmp_path / "a.png", exif=exif)
    # the EXIF standard: where row 0 and column 0 of the file are seen
    seen = {
        1: COLOURS,
        2: COLOURS[:, ::-1],
        3: COLOURS[::-1, ::-1],
        4: COLOURS[::-1],
        5: COLOURS.transpose(1, 0, 2),
        6: COLOURS.transpose(1, 0, 2)[:, ::-1],
        7: COLOURS.transpose(1, 0, 2)[::-1, ::-1],
        8: COLOURS.transpose(1, 0, 2)[::-1],
    }
    assert np.array_equal(read_image(tmp_path / "a.png").pixels.numpy(), seen[orientation])


def test_the_multi_picture_jpeg_of_phones(tmp_path: Path) -> None:
    smooth = Image.new("RGB", (16, 8), (200, 100, 50))
    smooth.save(tmp_path / "a.jpg", format="MPO", save_all=True, append_images=[smooth])
    image = read_image(tmp_path / "a.jpg").pixels.numpy().astype(int)
    assert image.shape == (8, 16, 3)
    assert np.abs(image - (200, 100, 50)).max() < 4


def test_floats_are_no_image(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((4, 5), np.float32)).save(tmp_path / "a.tiff")
    with pytest.raises(FileFormatError, match="8 or 16 bits"):
        read_image(tmp_path / "a.tiff")


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("name", ["a.png", "a.tiff", "a.ppm"])
def test_colour_of_a_few_more_than_8_bits_is_not_dark(tmp_path: Path, name: str, bits: int) -> None:
    deep = (COLOURS.astype(np.uint16) << (bits - 8)) + 1
    deep[0, 0] = 2**bits - 1
    _save_deep_colour(tmp_path / name, deep)
    image = read_image(tmp_path / name)
    assert np.array_equal(image.pixels.numpy(), deep >> (bits - 8))
    assert [note.kind for note in image.notes] == ["colour_stretched"]
    assert f"{bits}-bit" in image.notes[0].text


def test_what_is_read_as_written_has_no_notes(tmp_path: Path) -> None:
    for picture in (
        Image.fromarray(COLOURS), Image.fromarray(GREY), Image.fromarray(COLOURS).convert("P"),
        Image.fromarray(np.dstack([COLOURS, GREY]), "RGBA"),
    ):  # fmt: skip
        picture.save(tmp_path / "a.png")
        assert read_image(tmp_path / "a.png").notes == ()
    _save_deep_colour(tmp_path / "a.png", COLOURS.astype(np.uint16) * 257)
    assert read_image(tmp_path / "a.png").notes == ()


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tiff"])
@pytest.mark.parametrize(("orientation", "word"), [(6, "90 degrees clockwise"), (3, "180")])
def test_a_turned_image_says_so(tmp_path: Path, name: str, orientation: int, word: str) -> None:
    picture = Image.new("RGB", (16, 8), (200, 100, 50))
    exif = picture.getexif()
    exif[0x0112] = orientation
    picture.save(tmp_path / name, exif=exif)
    image = read_image(tmp_path / name)
    assert image.pixels.shape == ((16, 8, 3) if orientation == 6 else (8, 16, 3))
    assert [note.kind for note in image.notes] == ["image_turned"]
    assert word in image.notes[0].text


@pytest.mark.parametrize("orientation", range(1, 9))
def test_deep_colour_is_turned_too(tmp_path: Path, orientation: int) -> None:
    tagged = Image.fromarray(COLOURS)
    exif = tagged.getexif()
    exif[0x0112] = orientation
    for name in ("a.png", "a.tiff"):
        tagged.save(tmp_path / f"8{name}", exif=exif)
    _save_deep_colour(tmp_path / "a.png", COLOURS.astype(np.uint16) * 257)
    content = (tmp_path / "a.png").read_bytes()
    chunk = (tmp_path / "8a.png").read_bytes()
    start = chunk.index(b"eXIf") - 4
    length = int.from_bytes(chunk[start : start + 4], "big") + 12
    (tmp_path / "a.png").write_bytes(content[:33] + chunk[start : start + length] + content[33:])
    expected = read_image(tmp_path / "8a.png")
    assert torch.equal(read_image(tmp_path / "a.png").pixels, expected.pixels)
    assert torch.equal(read_image(tmp_path / "8a.tiff").pixels, expected.pixels)
    assert read_image(tmp_path / "a.png").notes == expected.notes


def test_a_deep_tiff_is_turned_once(tmp_path: Path) -> None:
    """A TIFF of 16-bit colour, written byte by byte, with the orientation tag."""
    deep = COLOURS.astype("<u2") * 257
    height, width = deep.shape[:2]
    tags = [
        (256, 3, 1, width), (257, 3, 1, height), (258, 3, 3, 8 + 2 + 9 * 12 + 4), (259, 3, 1, 1),
        (262, 3, 1, 2), (273, 4, 1, 8 + 2 + 9 * 12 + 4 + 6), (274, 3, 1, 6), (277, 3, 1, 3),
        (279, 4, 1, deep.nbytes),
    ]  # fmt: skip
    content = struct.pack("<2sHIH", b"II", 42, 8, len(tags))
    content += b"".join(struct.pack("<HHII", *tag) for tag in tags)
    content += struct.pack("<IHHH", 0, 16, 16, 16) + deep.tobytes()
    (tmp_path / "a.tiff").write_bytes(content)
    image = read_image(tmp_path / "a.tiff")
    assert np.array_equal(image.pixels.numpy(), COLOURS.transpose(1, 0, 2)[:, ::-1])
    assert [note.kind for note in image.notes] == ["image_turned"]


def test_heic_of_phones(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    smooth = np.full((64, 96, 3), (200, 100, 50), np.uint8)
    pillow_heif.from_pillow(Image.fromarray(smooth)).save(tmp_path / "a.heic")
    image = read_image(tmp_path / "a.heic").pixels.int()
    assert image.shape == (64, 96, 3)
    assert int((image - torch.from_numpy(smooth).int()).abs().max()) < 8
    (tmp_path / "b.heic").write_bytes(b"no heic")
    with pytest.raises(FileFormatError, match="damaged"):
        read_image(tmp_path / "b.heic")


def test_missing_and_foreign_files(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_image(tmp_path / "a.png")
    (tmp_path / "a.png").write_text("not an image")
    with pytest.raises(FileFormatError, match=r"a\.png: damaged, or not of its kind"):
        read_image(tmp_path / "a.png")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF", "BMP"])
def test_truncated_images_are_refused(tmp_path: Path, kind: str) -> None:
    buffer = io.BytesIO()
    Image.fromarray(np.tile(COLOURS, (20, 20, 1))).save(buffer, kind)
    content = buffer.getvalue()
    for kept in (0.5, 0.95):
        (tmp_path / "a.png").write_bytes(content[: int(kept * len(content))])
        with pytest.raises(FileFormatError, match="damaged"):
            read_image(tmp_path / "a.png")


def test_a_bomb_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    Image.new("1", (10_001, 10_000)).save(tmp_path / "a.png")
    with pytest.raises(FileFormatError, match="over 100 megapixels"):
        read_image(tmp_path / "a.png")


def test_real_frames(real_frames: Path) -> None:
    assert read_image(real_frames / "realsense_1" / "rgb.jpg").pixels.shape == (480, 640, 3)
