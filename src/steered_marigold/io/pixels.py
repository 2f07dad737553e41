"""The pixels of a picture file with all their bits, which Pillow cuts to 8 in colour."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import decoding, open_picture

_BITS_PER_SAMPLE = 258  # a tag of TIFF


def open_pixels(path: Path, picture: Image.Image) -> NDArray[Any]:
    """[height, width] or [height, width, channels], RGB first, as stored; picture: opened `path`.

    16-bit colour stays of 16 bits; palettes are looked up. No orientation is applied.
    """
    if picture.mode in ("P", "PA"):
        picture = picture.convert("RGBA")  # a palette may hold transparency
    if not _has_deep_channels(path, picture):
        return np.asarray(picture)
    with decoding(path):
        pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise FileFormatError(f"{path}: 16 bits a channel in a form that cannot be read")
        if pixels.ndim == 3 and pixels.shape[2] >= 3:
            pixels[..., :3] = pixels[..., 2::-1].copy()  # OpenCV has blue first
        return np.asarray(pixels)


def read_pixels(path: Path) -> NDArray[Any]:
    """As open_pixels, of the .png or .tiff at `path`; FileFormatError for anything else."""
    kind = "PNG" if path.suffix.lower() == ".png" else "TIFF"
    return open_pixels(path, open_picture(path, (kind,)))


def _has_deep_channels(path: Path, picture: Image.Image) -> bool:
    """Whether there are several channels of 16 bits."""
    if len(picture.getbands()) == 1:
        return False
    if picture.format == "PNG":
        with path.open("rb") as file:
            return file.read(25)[24] == 16  # the bit depth in the header chunk
    if picture.format == "TIFF":
        return 16 in picture.tag_v2.get(_BITS_PER_SAMPLE, ())  # type: ignore[attr-defined]
    return False
