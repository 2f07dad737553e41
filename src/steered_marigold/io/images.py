"""Colour and infrared images."""

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import ImageOps
from torch import Tensor

from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import AnyPath, decoding, open_picture

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm")
_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "PPM")
_DEEP_GREY = ("I", "I;16", "I;16B", "I;16L")


def read_image(path: AnyPath) -> UInt8[Tensor, "height width 3"]:
    """RGB in 0..255 from 8- or 16-bit RGB, RGBA, grey, infrared or palette files.

    Alpha is dropped; grey becomes three equal channels. 16-bit colour keeps its high byte. 16-bit
    grey is stretched so that its 99.9th percentile is white, because infrared cameras use a small
    part of the 16 bits. An EXIF orientation is applied.

    Raises FileFormatError for a missing or damaged file, one that is no image, or one over 100
    megapixels.
    """
    picture = open_picture(path, _FORMATS)
    with decoding(path):
        picture = ImageOps.exif_transpose(picture)
        if picture.mode in _DEEP_GREY:
            grey = np.asarray(picture).astype(np.float32)
            white = max(float(np.percentile(grey, 99.9)), 1.0)
            grey = np.rint(np.clip(grey / white, 0, 1) * 255).astype(np.uint8)
            return torch.from_numpy(grey)[..., None].repeat(1, 1, 3)
        if picture.mode == "F":
            raise FileFormatError(f"{path}: holds floats; the image must have 8 or 16 bits")
        if picture.mode in ("P", "PA"):
            picture = picture.convert("RGBA")  # a palette may hold transparency
        return torch.from_numpy(np.array(picture.convert("RGB")))
