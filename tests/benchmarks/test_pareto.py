"""The front, the table and the figure of what could be picked instead."""

from itertools import permutations
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from benchmarks.measuring import Timing
from benchmarks.pareto import Result, Results, compare, front, plot, table
from steered_marigold.core.frame import make_frame
from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.methods.interpolation import LinearCompleter, NearestCompleter

numbers = st.integers(1, 5).map(float)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=8, unique=True))
def test_the_front_is_what_nothing_beats(values: list[tuple[float, float]]) -> None:
    points = {str(index): value for index, value in enumerate(values)}
    beaten = {
        a
        for a, b in permutations(points, 2)
        if points[b][0] <= points[a][0] and points[b][1] <= points[a][1]
    }
    assert set(front(points)) == points.keys() - beaten


def ramp(frame_id: str) -> PreparedFrame:
    """Depth that rises to the right, every fifth column measured."""
    depth = torch.linspace(1, 4, 31).expand(20, 31).contiguous()
    mask = torch.zeros(20, 31, dtype=torch.bool)
    mask[:, ::5] = True
    return PreparedFrame(
        shown=make_frame(torch.zeros(20, 31, 3), depth, mask, id=frame_id),
        metric_depth=depth,
        areas={"full": torch.ones_like(mask), "hidden": ~mask},
        focus="hidden",
        known_area=None,
    )


def test_methods_are_compared_on_the_same_frames() -> None:
    methods = {"nearest": NearestCompleter(), "linear": LinearCompleter()}
    results = compare(methods, [ramp("a"), ramp("b")], repeats=3)
    assert results["linear"].abs_rel == pytest.approx(0, abs=1e-6)
    # one or two columns of .1 m away, with equal shares
    assert results["nearest"].rmse_m == pytest.approx((0.025**0.5), rel=1e-4)
    assert all(len(result.timing.seconds) == 3 for result in results.values())


def results() -> Results:
    return {
        "default": Result(Timing((4.0, 4.0, 8.0), 9), 0.01, 0.1),
        "fast": Result(Timing((1.0, 2.0, 2.0), 9), 0.02, 0.2),
        "slow": Result(Timing((5.0,), 9), 0.03, 0.3),
    }


def test_the_table_says_what_lies_on_the_front_and_how_fast_it_is() -> None:
    lines = table(results()).splitlines()[2:]
    assert lines[0] == "| fast | 2 | 1 to 2 | 9 | 2 | 0.0200 | 0.200 | yes |"
    assert lines[1].endswith("| 1 | 0.0100 | 0.100 | yes |")
    assert lines[2].endswith("| 0.8 | 0.0300 | 0.300 |  |")


def test_the_figure_has_a_panel_for_each_protocol(tmp_path: Path) -> None:
    for count in (1, 2):
        plot({str(index): results() for index in range(count)}, tmp_path / "pareto.png")
        with Image.open(tmp_path / "pareto.png") as picture:
            assert picture.size[0] == 660 * count
