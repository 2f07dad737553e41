"""Images of every kind become 8-bit RGB."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.images import read_image

COLOURS = np.random.default_rng(0).integers(0, 256, (6, 9, 3), dtype=np.uint8)
GREY = COLOURS[..., 0]


def _read(tmp_path: Path, picture: Image.Image, name: str = "a.png") -> np.ndarray:
    picture.save(tmp_path / name)
    return read_image(tmp_path / name).numpy()


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
    assert np.array_equal(read_image(tmp_path / "b.png").numpy(), expected)


def test_bilevel_images(tmp_path: Path) -> None:
    image = _read(tmp_path, Image.fromarray(GREY > 128))
    assert np.array_equal(image[..., 0], np.where(GREY > 128, 255, 0))


def test_16_bit_colour_keeps_its_high_byte(tmp_path: Path) -> None:
    import cv2

    deep = COLOURS.astype(np.uint16) * 257
    for name in ("a.png", "a.tiff"):
        cv2.imwrite(str(tmp_path / name), deep[..., ::-1])
        assert np.array_equal(read_image(tmp_path / name).numpy(), COLOURS)


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
    assert np.array_equal(read_image(tmp_path / "a.png").numpy(), seen[orientation])


def test_the_multi_picture_jpeg_of_phones(tmp_path: Path) -> None:
    smooth = Image.new("RGB", (16, 8), (200, 100, 50))
    smooth.save(tmp_path / "a.jpg", format="MPO", save_all=True, append_images=[smooth])
    image = read_image(tmp_path / "a.jpg").numpy().astype(int)
    assert image.shape == (8, 16, 3)
    assert np.abs(image - (200, 100, 50)).max() < 4


def test_floats_are_no_image(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((4, 5), np.float32)).save(tmp_path / "a.tiff")
    with pytest.raises(FileFormatError, match="8 or 16 bits"):
        read_image(tmp_path / "a.tiff")


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
    assert read_image(real_frames / "realsense_1" / "rgb.jpg").shape == (480, 640, 3)
