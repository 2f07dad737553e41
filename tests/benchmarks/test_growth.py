"""Exponents and plots of growth."""

from itertools import pairwise
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.growth import Growth, Load, Point, exponent_table, fitted_exponent, plot, sweeps
from benchmarks.measuring import Timing


def growth(preset: str) -> Growth:
    """Time grows with the square of x, memory in proportion."""
    points = [Point(x, Load(), Timing((x**2,), 50 * x)) for x in (1.0, 2.0, 4.0, 8.0)]
    return Growth("batch size", preset, tuple(points))


def test_a_power_law_gives_its_exponent() -> None:
    assert fitted_exponent([1, 10, 100], [3, 30, 300]) == pytest.approx(1)
    assert growth("default").exponents() == pytest.approx(
        {"time": 2, "time at the end": 2, "memory": 1, "memory at the end": 1}
    )


def test_a_table_has_a_row_a_preset() -> None:
    table = exponent_table([growth("default"), growth("fast")])
    assert "| batch size | fast | 2.00 | 2.00 | 1.00 | 1.00 |" in table


def test_sweeps_ascend_from_a_vga_frame_to_the_largest_image() -> None:
    for points in sweeps(8.0).values():
        assert all(before < after for (before, _), (after, _) in pairwise(points))
    sizes = sweeps(8.0)["image size [megapixels]"]
    assert sizes[0][1] == Load()
    assert sizes[-1][0] == pytest.approx(8, rel=0.01)


def test_a_plot_is_a_picture(tmp_path: Path) -> None:
    plot([growth("default"), growth("fast")], tmp_path / "growth.png")
    with Image.open(tmp_path / "growth.png") as picture:
        assert picture.size[0] > 800
