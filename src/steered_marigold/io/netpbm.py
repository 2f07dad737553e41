"""PGM, PPM and PFM files with all their bits: Pillow rescales what is not of 8 or 16 bits."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import decoding, require_pixel_count

# the fields of a header stand between blanks, and a comment may follow each
_GAP = rb"(?:\s|#[^\n]*\n)+"
_NETPBM = re.compile(rb"(P[2356])" + _GAP + rb"(\d+)" + _GAP + rb"(\d+)" + _GAP + rb"(\d+)\s")
_PFM = re.compile(rb"(P[Ff])\s+(\d+)\s+(\d+)\s+([-+0-9.eE]+)[^\S\n]*\n")


def read_netpbm(path: Path) -> tuple[NDArray[Any], int]:
    """The array [height, width] or [height, width, 3] of a .pgm or .ppm, and its largest code.

    uint8, or uint16 where the largest code is above 255 (big endian in binary files). Raises
    FileFormatError for a damaged or oversized file.
    """
    with decoding(path):
        content = path.read_bytes()
        header = _NETPBM.match(content)
        if header is None:
            raise FileFormatError(f"{path}: damaged, or not of its kind (no PGM or PPM header)")
        magic, (width, height, largest) = header[1], map(int, header.groups()[1:])
        channels = 3 if magic in (b"P3", b"P6") else 1
        require_pixel_count(path, width, height)
        if not 0 < largest <= 65535:
            raise FileFormatError(f"{path}: the largest code is {largest}, not 1 to 65535")
        count, kind = width * height * channels, np.dtype(">u2" if largest > 255 else "u1")
        if magic in (b"P2", b"P3"):
            text = re.sub(rb"#[^\n]*", b"", content[header.end() :])
            codes = np.array(text.split()[:count], np.int64)
        else:
            codes = np.frombuffer(content, kind, count, header.end())
        if codes.size != count or (count and codes.max() > largest):
            raise FileFormatError(f"{path}: damaged, or not of its kind (pixels do not fit)")
    shape = (height, width, channels) if channels > 1 else (height, width)
    return codes.astype(kind.newbyteorder("=")).reshape(shape), largest


def read_pfm(path: Path) -> NDArray[Any]:
    """The floats [height, width] or [height, width, 3] of a .pfm, whose lowest row comes first."""
    with decoding(path):
        content = path.read_bytes()
        header = _PFM.match(content)
        if header is None:
            raise FileFormatError(f"{path}: damaged, or not of its kind (no PFM header)")
        channels, width, height = 3 if header[1] == b"PF" else 1, int(header[2]), int(header[3])
        require_pixel_count(path, width, height)
        kind = "<f4" if float(header[4]) < 0 else ">f4"  # the sign of the scale tells the order
        values = np.frombuffer(content, kind, width * height * channels, header.end())
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.ascontiguousarray(values.reshape(shape)[::-1].astype(np.float32))
