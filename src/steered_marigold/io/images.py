"""Colour and infrared images."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from steered_marigold.core.colours import FULL_RANGE, to_8_bits
from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import (
    AnyPath,
    atomic_write,
    decoding,
    open_picture,
    require_file,
    require_suffix,
)
from steered_marigold.io.heif import HEIF_SUFFIXES, open_heif
from steered_marigold.io.netpbm import read_netpbm
from steered_marigold.io.pixels import open_pixels

_NETPBM_SUFFIXES = (".ppm", ".pgm")
IMAGE_SUFFIXES = (
    ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", *_NETPBM_SUFFIXES, *HEIF_SUFFIXES
)  # fmt: skip
_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "PPM")
_ORIENTATION = 0x0112
_TURNS = {
    2: "mirrored", 3: "turned by 180 degrees", 4: "mirrored upside down", 5: "transposed",
    6: "turned by 90 degrees clockwise", 7: "transposed and turned by 180 degrees",
    8: "turned by 90 degrees counterclockwise",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ColorImage:
    """pixels: RGB in 0..255. notes: what was read otherwise than written."""

    pixels: UInt8[Tensor, "height width 3"]
    notes: Notices = ()


def read_image(path: AnyPath) -> ColorImage:
    """RGB in 0..255 from 8- or 16-bit RGB, RGBA, grey, infrared or palette files.

    Alpha is dropped; grey becomes three equal channels. 16-bit colour keeps its high byte, or, if
    its largest value fits 10, 12 or 14 bits, the highest byte of those. 16-bit grey is stretched
    so that its 99.9th percentile is white, because infrared cameras use a small part of the 16
    bits. An EXIF orientation is applied. All but the dropping of alpha is in the notes.

    Raises FileFormatError for a missing or damaged file, one that is no image, or one over 100
    megapixels; MissingExtraError for HEIC without pillow-heif.
    """
    path = require_file(path)
    if path.suffix.lower() in _NETPBM_SUFFIXES:
        (pixels, largest), orientation = _netpbm(path), 1
    else:
        is_heif = path.suffix.lower() in HEIF_SUFFIXES
        picture = open_heif(path) if is_heif else open_picture(path, _FORMATS)
        with decoding(path):
            if picture.mode == "F":
                raise FileFormatError(f"{path}: holds floats; the image must have 8 or 16 bits")
            pixels, largest = _unfolded(path, picture), FULL_RANGE
            orientation = _orientation(path, picture)
    pixels, notes = to_8_bits(pixels, largest)
    if orientation in _TURNS:
        if picture.format != "TIFF":  # decoders turn these themselves
            pixels = _turned(pixels, orientation)
        text = f"The image was {_TURNS[orientation]}, as its EXIF orientation says."
        notes = (*notes, Notice("image_turned", text))
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    return ColorImage(pixels=torch.from_numpy(np.array(pixels[..., :3])), notes=notes)


def write_image(path: AnyPath, image: UInt8[Tensor, "height width 3"]) -> None:
    """Writes RGB in 0..255 as .png; InputError if `path` cannot be written."""
    require_suffix(path, (".png",))
    with atomic_write(path) as temporary:
        Image.fromarray(image.cpu().numpy()).save(temporary)


def _netpbm(path: Path) -> tuple[NDArray[Any], int]:
    """Pixels and the code of white; what has 8 bits uses all of them."""
    pixels, largest = read_netpbm(path)
    if pixels.dtype == np.uint8:
        pixels = np.rint(pixels * (255 / largest)).astype(np.uint8)
    return pixels, largest


def _unfolded(path: Path, picture: Image.Image) -> NDArray[Any]:
    """[height, width] of 8 or more bits, or [height, width, 3] of 8 or 16."""
    pixels = open_pixels(path, picture)
    if pixels.ndim == 3 and pixels.dtype == np.uint16:
        return pixels[..., 0] if pixels.shape[2] < 3 else pixels[..., :3]
    if len(picture.getbands()) == 1 and pixels.dtype not in (np.uint8, np.bool_):
        return pixels
    if picture.mode in ("P", "PA"):
        picture = picture.convert("RGBA")  # a palette may hold transparency
    return np.asarray(picture.convert("RGB"))


def _orientation(path: Path, picture: Image.Image) -> int:
    """The EXIF orientation 1..8 that the file holds."""
    if picture.format != "TIFF":
        return int(picture.getexif().get(_ORIENTATION, 1))
    with Image.open(path) as header:  # loading the pixels of a TIFF removes the tag
        return int(header.getexif().get(_ORIENTATION, 1))


def _turned(pixels: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """As the EXIF orientation 1..8 says: 5 to 8 are transposed first, then mirrored."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels[:, ::-1] if orientation in (2, 3, 6, 7) else pixels
