"""The place of one camera seen from another."""

import json

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.geometry import rotation_of
from steered_marigold.errors import FileFormatError
from steered_marigold.io.camera_files import camera_text, parse_numbers
from steered_marigold.io.files import AnyPath


def read_extrinsics(source: AnyPath) -> Float[Tensor, "4 4"]:
    """The rotation and translation [m] from one camera's frame to another's, as 4x4.

    source: "x,y,z" for a translation alone, or a file with those; or with a 4x4, or its first
    three rows; or "x y z qx qy qz qw" (TUM); or JSON with `rotation` (column by column) and
    `translation`, as RealSense has it.

    Raises FileFormatError for anything else.
    """
    lines = camera_text(source).splitlines()
    numbers = _numbers("\n".join(line.split("#")[0] for line in lines))
    matrix = torch.eye(4, dtype=torch.float64)
    if len(numbers) == 3:
        matrix[:3, 3] = torch.tensor(numbers)
    elif len(numbers) == 7:
        quaternion = torch.tensor(numbers[3:], dtype=torch.float64)
        matrix[:3, :3] = rotation_of(quaternion / quaternion.norm())
        matrix[:3, 3] = torch.tensor(numbers[:3])
    elif len(numbers) in (12, 16):
        matrix[: len(numbers) // 4] = torch.tensor(numbers).reshape(-1, 4)
    else:
        raise FileFormatError(
            f"{source}: extrinsics are a 4x4 or 3x4 matrix, x y z, or x y z qx qy qz qw, in metres"
        )
    matrix = matrix.float()
    if not matrix.isfinite().all():
        raise FileFormatError(f"{source}: a number is not finite, or a rotation is zero")
    return matrix


def _numbers(text: str) -> list[float]:
    """Those of the text; of RealSense's JSON, put in the order of a 3x4 matrix."""
    if not text.lstrip().startswith("{"):
        return parse_numbers(text) or []
    try:
        fields = json.loads(text)
        columns, translation = fields["rotation"], fields["translation"]
        return [float(value) for row in range(3) for value in (*columns[row::3], translation[row])]
    except (ValueError, KeyError, IndexError, TypeError):
        return []
