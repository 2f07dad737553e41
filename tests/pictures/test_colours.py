"""Scales, and measurements that can be seen."""

import numpy as np
import pytest

from steered_marigold.pictures.colours import (
    LEAST_UNCERTAINTY,
    enlarged,
    robust_range,
    sparse_picture,
    uncertainty_range,
)


def test_a_range_is_of_what_is_known_and_never_empty() -> None:
    values = np.concatenate([np.linspace(1, 2, 1001), [np.nan, np.inf]])
    scale = robust_range(values)
    assert [scale.vmin, scale.vmax] == pytest.approx([1.01, 1.99])
    for values in (np.full(9, 3.0), np.full(9, np.nan)):
        scale = robust_range(values)
        assert scale.vmin is not None
        assert scale.vmax is not None
        assert scale.vmax > scale.vmin


def test_a_range_of_uncertainty_does_not_show_noise() -> None:
    for values in (np.full(9, 1e-4), np.full(9, np.nan)):
        scale = uncertainty_range(values)
        assert (scale.vmin, scale.vmax) == (0, LEAST_UNCERTAINTY)
    assert uncertainty_range(np.linspace(0, 1, 1001)).vmax == pytest.approx(0.98)


@pytest.mark.parametrize("radius", [0, 1, 3])
def test_points_grow_into_discs_of_the_nearest_value(radius: int) -> None:
    values = np.full((12, 15), np.nan)
    points = {(2, 3): 1.0, (8, 10): 2.0, (9, 12): 3.0}
    for point, value in points.items():
        values[point] = value
    drawn = enlarged(values, radius=radius)
    for pixel in np.ndindex(drawn.shape):
        distances = {p: np.hypot(*np.subtract(pixel, p)) for p in points}
        nearest = min(distances.values())
        if nearest > radius:
            assert np.isnan(drawn[pixel])
        else:
            assert drawn[pixel] in {points[p] for p, d in distances.items() if d == nearest}


def test_only_few_measurements_are_enlarged() -> None:
    depth, mask = np.ones((10, 10)), np.zeros((10, 10), bool)
    mask[0, 0] = True
    assert np.isfinite(sparse_picture(depth, mask, below=0.02, radius=2)).sum() == 6
    assert np.isfinite(sparse_picture(depth, mask, below=0.01, radius=2)).sum() == 1
    assert not np.isfinite(sparse_picture(depth, mask & False, below=0.5, radius=2)).any()
