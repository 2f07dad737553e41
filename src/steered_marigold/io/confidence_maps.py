"""How far each measurement may be believed, as some sensors tell."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import FileFormatError
from steered_marigold.io.files import (
    AnyPath,
    load_array,
    open_picture,
    require_file,
    require_suffix,
)

CONFIDENCE_SUFFIXES = (".png", ".npy")
_PNG_WHITE = {"L": 255, "I;16": 65535}


def read_confidence(path: AnyPath) -> Float[Tensor, "height width"]:
    """Confidence in [0, 1]: a grey .png of 8 or 16 bits over its full range, or a float .npy.

    Raises FileFormatError for a missing or damaged file, an unknown extension, several channels,
    or floats outside [0, 1].
    """
    path = require_file(path)
    if require_suffix(path, CONFIDENCE_SUFFIXES) == ".png":
        picture = open_picture(path, ("PNG",))
        if picture.mode not in _PNG_WHITE:
            raise FileFormatError(f"{path}: confidence must be grey, not {picture.mode}")
        return torch.from_numpy(np.asarray(picture) / np.float32(_PNG_WHITE[picture.mode]))
    values = load_array(path)
    if values.ndim != 2 or values.dtype.kind != "f":
        raise FileFormatError(
            f"{path}: confidence must be floats [height, width], "
            f"not {values.dtype} {list(values.shape)}"
        )
    if not ((values >= 0) & (values <= 1)).all():
        raise FileFormatError(f"{path}: confidence must lie in 0..1; divide by its largest value")
    return torch.from_numpy(values.astype(np.float32))
