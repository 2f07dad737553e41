"""Depth codes whose bits look out of order: swapped bytes, and the rotated bits of SUN RGB-D."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steered_marigold.core.notices import Notice, Notices

_FEWEST_NEIGHBOURS = 500  # pairs of measured neighbours, below which nothing is judged
_ROUGHER = 3.0  # by how much swapped bytes make neighbours differ more, at least
_SUNRGBD_TYPICAL_MM = (300, 8000)


def code_doubts(codes: NDArray[Any]) -> Notices:
    """Notices about 16-bit codes [height, width], 0 and 65535 = no measurement; none for others."""
    if codes.dtype.kind != "u" or codes.dtype.itemsize != 2:
        return ()
    codes = codes.astype(np.uint16)
    measured = (codes > 0) & (codes < 65535)
    if measured.sum() < _FEWEST_NEIGHBOURS:
        return ()
    if _looks_byte_swapped(codes, measured):
        text = (
            "The depth map looks byte-swapped (its neighbours fit only with high and low byte "
            "exchanged); write it again in the byte order of its format, PNG is big endian."
        )
        return (Notice("byte_swapped", text),)
    if _looks_bit_rotated(codes[measured]):
        text = (
            "The depth map looks as SUN RGB-D stores it, with its bits rotated by 3; if it is, "
            "give `depth_encoding` sunrgbd."
        )
        return (Notice("bit_rotated", text),)
    return ()


def _looks_byte_swapped(codes: NDArray[np.uint16], measured: NDArray[np.bool_]) -> bool:
    """Neighbours that differ much as they are, and little with their bytes exchanged.

    Means, not medians: most neighbours are equal where a sensor counts in coarse steps.
    """
    pairs = measured[:, 1:] & measured[:, :-1]
    if pairs.sum() < _FEWEST_NEIGHBOURS:
        return False
    step, swapped_step = (
        float(np.abs(np.diff(values.astype(np.int32), axis=1))[pairs].mean())
        for values in (codes, codes.byteswap())
    )
    typical = float(np.median(codes.byteswap()[measured]))
    return step > _ROUGHER * swapped_step and swapped_step < 0.05 * typical


def _looks_bit_rotated(codes: NDArray[np.uint16]) -> bool:
    """Nearly all are multiples of 8, and an eighth of them is an everyday depth in millimetres."""
    low, high = _SUNRGBD_TYPICAL_MM
    typical = float(np.median(codes >> 3))
    eighths = float(np.mean(codes % 8 == 0))
    return eighths > 0.98 and low < typical < high and float(np.median(codes)) > high
