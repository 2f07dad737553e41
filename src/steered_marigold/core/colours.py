"""Images of more than 8 bits as the 8 that models take."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steered_marigold.core.notices import Notice, Notices

FULL_RANGE = 65535
_SENSOR_BITS = (10, 12, 14)


def to_8_bits(pixels: NDArray[Any], largest: int = FULL_RANGE) -> tuple[NDArray[np.uint8], Notices]:
    """The codes as 0..255, and what was stretched for it. largest: the code of white."""
    if pixels.dtype == np.uint8:
        return pixels, ()
    if pixels.ndim == 2:
        grey = pixels.astype(np.float32)
        white = max(float(np.percentile(grey, 99.9)), 1.0)
        stretched = np.rint(np.clip(grey / white, 0, 1) * 255).astype(np.uint8)
        text = f"The 16-bit grey image was stretched so that its value {white:.0f} is white."
        return stretched, (Notice("grey_stretched", text),)
    if largest != FULL_RANGE:
        return np.rint(pixels * (255 / largest)).astype(np.uint8), ()
    brightest = int(pixels.max())
    bits = next((bits for bits in _SENSOR_BITS if brightest < 2**bits), 16)
    notes: Notices = ()
    if bits < 16:
        text = (
            f"The colours use {bits} of their 16 bits (the largest is {brightest}) and were read "
            f"as {bits}-bit."
        )
        notes = (Notice("colour_stretched", text),)
    return (pixels >> (bits - 8)).astype(np.uint8), notes
