"""Pairs against a greedy match of all stamps at once."""

from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.io.bags.pairing import StampPairer

stamps = st.lists(st.integers(0, 300), max_size=30).map(sorted)
Pairs = list[tuple[int, int]]


def _stream(images: list[int], depths: list[int], slop: int) -> tuple[Pairs, StampPairer[int]]:
    """Indices (image, depth) of the pairs, the messages arriving in the order of their stamps."""
    pairer: StampPairer[int] = StampPairer(slop)
    pairs = []
    events = [(stamp, 0, i) for i, stamp in enumerate(images)]
    events += [(stamp, 1, i) for i, stamp in enumerate(depths)]
    for stamp, kind, i in sorted(events):
        pairs += list((pairer.add_depth if kind else pairer.add_image)(stamp, i))
    return pairs + list(pairer.finish()), pairer


def _greedy(images: list[int], depths: list[int], slop: int) -> Pairs:
    """The closest pair first, then the closest of the rest."""
    order = sorted((abs(a - b), d, i) for i, a in enumerate(images) for d, b in enumerate(depths))
    pairs: Pairs = []
    for gap, d, i in order:
        if gap <= slop and all(i != pair[0] and d != pair[1] for pair in pairs):
            pairs.append((i, d))
    return sorted(pairs, key=lambda pair: pair[1])


@given(stamps, stamps, st.integers(0, 40))
def test_streamed_pairs_are_those_of_the_whole(
    images: list[int], depths: list[int], slop: int
) -> None:
    pairs, pairer = _stream(images, depths, slop)
    assert pairs == _greedy(images, depths, slop)
    assert pairer.counts.paired == len(pairs)
    assert pairer.counts.unpaired_images == len(images) - len(pairs)
    assert pairer.counts.unpaired_depths == len(depths) - len(pairs)


@given(st.lists(st.integers(0, 9), max_size=20), st.integers(0, 9), st.integers(0, 20))
def test_a_topic_may_arrive_later(jitter: list[int], slop: int, delay: int) -> None:
    """What arrives `delay` frames late is paired as if it came in time."""
    images = [20 * i + j for i, j in enumerate(jitter)]
    depths = [20 * i for i in range(len(jitter))]
    pairer: StampPairer[int] = StampPairer(slop)
    pairs = []
    for step in range(len(jitter) + delay):
        if step < len(jitter):
            pairs += list(pairer.add_depth(depths[step], step))
        if step >= delay:
            pairs += list(pairer.add_image(images[step - delay], step - delay))
    pairs += list(pairer.finish())
    assert pairs == _greedy(images, depths, slop)


def test_waiting_messages_are_bounded() -> None:
    """A topic that stops does not make the other one pile up."""
    pairer: StampPairer[int] = StampPairer(5)
    for i in range(1000):
        assert list(pairer.add_depth(10 * i, i)) == []
    assert pairer.counts.unpaired_depths == 1000 - 64
    list(pairer.finish())
    assert pairer.counts.unpaired_depths == 1000
