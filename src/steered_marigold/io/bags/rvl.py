"""RVL, the lossless code of 16-bit depth that ROS may put into `compressedDepth`.

A. D. Wilson, "Fast lossless depth image compression", ISS 2017. Pixels are runs: a count of zeros,
a count of non-zeros, and each non-zero as its zigzag difference from the one before. A number is
written three bits at a time, least significant first, each with a bit that says whether more
follow; eight of these four-bit groups fill a 32-bit little-endian word from its top.
"""

import numpy as np
from jaxtyping import UInt16
from numpy.typing import NDArray

_GROUPS_A_WORD = 8
_SHIFTS = np.arange(28, -1, -4, dtype=np.uint32)


def encode_rvl(pixels: UInt16[np.ndarray, "count"]) -> bytes:
    """The code of the pixels, row after row."""
    numbers: list[NDArray[np.int64]] = []
    known = np.flatnonzero(np.diff(np.concatenate(([False], pixels != 0, [False]))))
    previous, end = 0, 0
    for start, stop in known.reshape(-1, 2):
        run = pixels[start:stop].astype(np.int64)
        steps = np.diff(run, prepend=previous)
        zigzag = (steps << 1) ^ (steps >> 63)
        numbers += [np.array([start - end, stop - start]), zigzag]
        previous, end = int(run[-1]), stop
    if end < len(pixels):
        numbers.append(np.array([len(pixels) - end, 0]))
    return _pack(np.concatenate(numbers) if numbers else np.zeros(0, np.int64))


def decode_rvl(code: bytes, count: int) -> UInt16[np.ndarray, "count"]:
    """The `count` pixels of the code; ValueError if it is damaged."""
    numbers = _unpack(code)
    pixels = np.zeros(count, np.int64)
    place, read, previous = 0, 0, 0
    while place < count:
        if read + 2 > len(numbers):
            raise ValueError("the RVL code ends too early")
        zeros, known = int(numbers[read]), int(numbers[read + 1])
        read += 2
        place += zeros
        if place + known > count or read + known > len(numbers):
            raise ValueError("the RVL code holds more than the picture")
        zigzag = numbers[read : read + known]
        run = previous + np.cumsum((zigzag >> 1) ^ -(zigzag & 1))
        pixels[place : place + known] = run
        if known:
            previous = int(run[-1])
        place, read = place + known, read + known
    return pixels.astype(np.uint16)


def _pack(numbers: NDArray[np.int64]) -> bytes:
    """Numbers as groups of four bits in words."""
    lengths = np.ones(len(numbers), np.int64)
    for digits in range(1, 7):
        lengths += numbers >> (3 * digits) > 0
    ends = np.cumsum(lengths)
    total = int(ends[-1]) if len(ends) else 0
    digit = np.arange(total) - np.repeat(ends - lengths, lengths)
    groups = np.repeat(numbers, lengths) >> (3 * digit) & 7
    more = np.ones(total, np.int64)
    more[ends - 1] = 0
    padded = np.zeros(-(-total // _GROUPS_A_WORD) * _GROUPS_A_WORD, np.uint32)
    padded[:total] = groups | more << 3
    words = (padded.reshape(-1, _GROUPS_A_WORD) << _SHIFTS).sum(axis=1, dtype=np.uint32)
    return bytes(words.astype("<u4").tobytes())


def _unpack(code: bytes) -> NDArray[np.int64]:
    """The numbers in the words; those that the last word's padding spells come along, as zeros."""
    words = np.frombuffer(code, "<u4", count=len(code) // 4)
    groups = (words[:, None] >> _SHIFTS & 15).ravel().astype(np.int64)
    ends = np.flatnonzero(groups < 8)
    starts = np.concatenate(([0], ends[:-1] + 1)) if len(ends) else ends
    groups = groups[: ends[-1] + 1] if len(ends) else groups[:0]
    digit = np.arange(len(groups)) - np.repeat(starts, ends - starts + 1)
    if len(digit) and digit.max() > 6:
        raise ValueError("the RVL code holds a number of more than 21 bits")
    values = np.left_shift(groups & 7, 3 * digit)
    return np.add.reduceat(values, starts) if len(starts) else values
