"""The pixels beside a pixel."""

from collections.abc import Iterator
from typing import NamedTuple


class Pairs(NamedTuple):
    """Two parts of a map whose pixels are neighbours, (down, right) apart."""

    here: tuple[slice, slice]
    there: tuple[slice, slice]
    down: int
    right: int


def neighbouring(height: int, width: int) -> Iterator[Pairs]:
    """All pairs of pixels that touch, by side or corner, each once."""
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
        there = (slice(down, height), slice(max(0, right), width - max(0, -right)))
        yield Pairs(here, there, down, right)
