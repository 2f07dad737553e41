"""How far each measurement may be believed, as some sensors tell."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.notices import Notice, Notices
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
_LEVELS = np.array([0, 0.5, 1], np.float32)  # ARKit: low, medium, high
_PER_CENT = 100


@dataclass(frozen=True, kw_only=True)
class ConfidenceMap:
    """confidence: in [0, 1]. notes: what was read otherwise than written, or is doubtful."""

    confidence: Float[Tensor, "height width"]
    notes: Notices = ()


def read_confidence(path: AnyPath) -> ConfidenceMap:
    """Confidence in [0, 1]: a grey .png of 8 or 16 bits over its full range, or a float .npy.

    Whole numbers up to 2 are the levels low, medium and high of ARKit, with the weights 0, 0.5
    and 1; up to 1, a mask. The notes say so.

    Raises FileFormatError for a missing or damaged file, an unknown extension, several channels,
    or numbers outside [0, 1] that are no levels.
    """
    path = require_file(path)
    if require_suffix(path, CONFIDENCE_SUFFIXES) == ".png":
        picture = open_picture(path, ("PNG",))
        if picture.mode == "1":
            return _from_levels(np.asarray(picture).astype(np.uint8))
        if picture.mode not in _PNG_WHITE:
            raise FileFormatError(f"{path}: confidence must be grey, not {picture.mode}")
        codes, white = np.asarray(picture), _PNG_WHITE[picture.mode]
        if codes.max() <= 2:
            return _from_levels(codes)
        return ConfidenceMap(
            confidence=torch.from_numpy(codes / np.float32(white)), notes=_doubts(codes, white)
        )
    values = load_array(path)
    if values.ndim == 2 and values.dtype.kind in "uib" and set(np.unique(values)) <= {0, 1, 2}:
        return _from_levels(values.astype(np.uint8))
    if values.ndim != 2 or values.dtype.kind != "f":
        raise FileFormatError(
            f"{path}: confidence must be floats [height, width], or whole levels up to 2, "
            f"not {values.dtype} {list(values.shape)}"
        )
    if not ((values >= 0) & (values <= 1)).all():
        raise FileFormatError(f"{path}: confidence must lie in 0..1; divide by its largest value")
    return ConfidenceMap(confidence=torch.from_numpy(values.astype(np.float32)))


def _from_levels(levels: NDArray[Any]) -> ConfidenceMap:
    if levels.max() == 2:
        confidence = _LEVELS[levels]
        text = "The confidence holds the levels 0, 1, 2; they were read as weights of 0, 0.5, 1."
    else:
        confidence = levels.astype(np.float32)
        text = "The confidence holds only 0 and 1; 1 was read as fully believed."
    notes = (Notice("confidence_levels", text),)
    return ConfidenceMap(confidence=torch.from_numpy(confidence), notes=notes)


def _doubts(codes: NDArray[Any], white: int) -> Notices:
    """A largest code far below white: per cent, or levels of another camera."""
    largest = int(codes.max())
    if largest > _PER_CENT:
        return ()
    text = (
        f"The largest confidence is {largest} of {white}, so nothing is believed by more than "
        f"{largest / white:.0%}; if {largest} means certain, rescale the file to 0..{white}."
    )
    return (Notice("confidence_low", text),)
