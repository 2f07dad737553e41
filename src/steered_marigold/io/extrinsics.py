"""Where one camera is, seen from another."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import FileFormatError
from steered_marigold.io.camera_files import parse_numbers
from steered_marigold.io.files import AnyPath, decoding, require_file


def read_extrinsics(source: AnyPath) -> Float[Tensor, "4 4"]:
    """A rigid motion [m] from "x,y,z" (no rotation), or from a file of a 4x4 or 3x4 matrix.

    It takes points of the depth camera's frame to the image camera's. Raises FileFormatError for
    anything else.
    """
    numbers = parse_numbers(str(source))
    if numbers is None:
        path = require_file(source)
        with decoding(path):
            numbers = parse_numbers(Path(path).read_text(encoding="utf-8-sig"))
    if numbers is None or len(numbers) not in (3, 12, 16):
        raise FileFormatError(f"{source}: extrinsics are x,y,z in metres, or a 3x4 or 4x4 matrix")
    matrix = torch.eye(4)
    if len(numbers) == 3:
        matrix[:3, 3] = torch.tensor(numbers)
        return matrix
    matrix.flatten()[: len(numbers)] = torch.tensor(numbers)
    return matrix
