"""Depth and images by their stamps."""

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

Item = TypeVar("Item")
# messages of a topic that may wait for a partner: bounds the memory
_LONGEST_QUEUE = 64
_NEVER = 2**63


@dataclass
class PairCounts:
    """What became of the messages so far."""

    paired: int = 0
    unpaired_images: int = 0
    unpaired_depths: int = 0


@dataclass(eq=False)
class _Waiting(Generic[Item]):
    stamp: int
    item: Item
    partner: "_Waiting[Item] | None" = None


class StampPairer(Generic[Item]):
    """Pairs images and depths by their stamps [ns], each used at most once.

    The closest pair of all is joined first, then the closest of the rest, and so on, if they are
    at most `slop_ns` apart; ties go to the earlier depth, then to the earlier image. A pair is
    given out as soon as nothing that may still come can change it, in the order of the depths.
    Stamps are expected to rise; of each topic at most 64 messages wait, the oldest is then given
    up.
    """

    def __init__(self, slop_ns: int) -> None:
        self.counts = PairCounts()
        self._slop = slop_ns
        self._images: list[_Waiting[Item]] = []
        self._depths: list[_Waiting[Item]] = []
        self._last_image = self._last_depth = -_NEVER

    def add_image(self, stamp: int, item: Item) -> Iterator[tuple[Item, Item]]:
        """Takes an image and yields the pairs (image, depth) that are now certain."""
        self._last_image = max(self._last_image, stamp)
        insort(self._images, _Waiting(stamp, item), key=lambda waiting: waiting.stamp)
        yield from self._settle()
        if len(self._images) > _LONGEST_QUEUE:
            del self._images[0]
            self.counts.unpaired_images += 1

    def add_depth(self, stamp: int, item: Item) -> Iterator[tuple[Item, Item]]:
        """Takes a depth and yields the pairs (image, depth) that are now certain."""
        self._last_depth = max(self._last_depth, stamp)
        insort(self._depths, _Waiting(stamp, item), key=lambda waiting: waiting.stamp)
        yield from self._settle()
        if len(self._depths) > _LONGEST_QUEUE:
            del self._depths[0]
            self.counts.unpaired_depths += 1
            yield from self._given_out()

    def finish(self) -> Iterator[tuple[Item, Item]]:
        """Nothing more comes: yields the remaining pairs."""
        self._last_image = self._last_depth = 2 * _NEVER
        yield from self._settle()

    def _settle(self) -> Iterator[tuple[Item, Item]]:
        while self._join_one():
            pass
        hopeless = [image for image in self._images if self._is_hopeless(image)]
        self.counts.unpaired_images += len(hopeless)
        self._images = [image for image in self._images if image not in hopeless]
        yield from self._given_out()

    def _join_one(self) -> bool:
        """Joins a depth and an image that are each other's closest and will remain so."""
        for depth in self._free_depths():
            image = self._closest(depth.stamp, self._images)
            if image is None or self._closest(image.stamp, self._free_depths()) is not depth:
                continue
            gap = abs(image.stamp - depth.stamp)
            if self._last_image - depth.stamp >= gap and self._last_depth - image.stamp >= gap:
                depth.partner = image
                self._images.remove(image)
                return True
        return False

    def _closest(self, stamp: int, among: list[_Waiting[Item]]) -> _Waiting[Item] | None:
        """The first of the closest that are near enough."""
        closest = min(among, key=lambda other: abs(other.stamp - stamp), default=None)
        return closest if closest and abs(closest.stamp - stamp) <= self._slop else None

    def _free_depths(self) -> list[_Waiting[Item]]:
        return [depth for depth in self._depths if depth.partner is None]

    def _is_hopeless(self, image: _Waiting[Item]) -> bool:
        """No depth is near enough, nor can one come."""
        over = self._last_depth > image.stamp + self._slop
        return over and self._closest(image.stamp, self._free_depths()) is None

    def _given_out(self) -> Iterator[tuple[Item, Item]]:
        """The pairs at the front of the depths, whose fate is known."""
        while self._depths:
            depth = self._depths[0]
            if depth.partner is None:
                over = self._last_image > depth.stamp + self._slop
                if not over or self._closest(depth.stamp, self._images) is not None:
                    return
                self.counts.unpaired_depths += 1
                del self._depths[0]
            else:
                self.counts.paired += 1
                del self._depths[0]
                yield depth.partner.item, depth.item
