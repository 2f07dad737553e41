"""Camera intrinsics."""

import re
from math import isfinite
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import AnyPath, decoding, require_file


def read_intrinsics(source: AnyPath) -> Float[Tensor, "3 3"]:
    """K [px] from "fx,fy,cx,cy", or from a text file that holds those four numbers or a 3x3 K.

    In a file, blanks, commas and line ends separate. Pixel centres are at integer coordinates.

    Raises FileFormatError if it is neither, or not the K of a pinhole camera.
    """
    numbers = _numbers(str(source))
    if numbers is None:
        path = require_file(source)
        with decoding(path):
            numbers = _numbers(Path(path).read_text(encoding="utf-8"))
    if numbers is None or len(numbers) not in (4, 9):
        raise FileFormatError(f"{source}: intrinsics are a 3x3 K or fx,fy,cx,cy")
    if len(numbers) == 4:
        fx, fy, cx, cy = numbers
        numbers = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
    fx, _, _, zero, fy, _, *last_row = numbers
    if fx <= 0 or fy <= 0 or zero != 0 or last_row != [0, 0, 1]:
        raise FileFormatError(
            f"{source}: K must be [fx, skew, cx; 0, fy, cy; 0, 0, 1] with positive focal lengths"
        )
    return torch.tensor(numbers, dtype=torch.float32).reshape(3, 3)


def _numbers(text: str) -> list[float] | None:
    """Finite numbers separated by blanks and commas; None if anything else is there."""
    try:
        numbers = [float(word) for word in re.split(r"[\s,;\[\]]+", text) if word]
    except ValueError:
        return None
    return numbers if all(map(isfinite, numbers)) else None
