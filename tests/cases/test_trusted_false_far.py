"""Readings of 65 m on a wet floor are noticed as a second kind of number."""

from collections.abc import Callable
from pathlib import Path

from steered_marigold.core.doubts import scale_doubts
from steered_marigold.io.depth_maps import read_depth


def test_the_case(case: Callable[[str], Path]) -> None:
    read = read_depth(case("trusted_false_far") / "depth.png")
    notices = scale_doubts(read.depth, read.valid_mask)
    assert [notice.kind for notice in notices] == ["second_mode"]
    assert "`max_depth`" in notices[0].text
