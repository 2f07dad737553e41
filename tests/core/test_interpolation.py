"""The interpolant against scipy's, pixel by pixel, and its laws."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import griddata

from steered_marigold.core.interpolation import ScatteredInterpolant, push_pull
from steered_marigold.errors import NoMeasurementsError

SHAPE = (31, 43)


def random_points(seed: int, share: float = 0.05, *, corners: bool = True) -> torch.Tensor:
    mask = torch.rand(SHAPE, generator=torch.Generator().manual_seed(seed)) < share
    mask[[0, 0, -1, -1], [0, -1, 0, -1]] = corners
    return mask.nonzero().flip(-1)


@given(seed=st.integers(0, 10_000), share=st.floats(0.0, 0.5))
@settings(max_examples=40)
def test_equals_griddata(seed: int, share: float) -> None:
    points = random_points(seed, share)
    values = torch.rand(len(points), generator=torch.Generator().manual_seed(seed))
    grid = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    expected = griddata(points.numpy(), values.numpy(), tuple(grid), method="linear")
    result = ScatteredInterpolant(points, SHAPE)(values)
    np.testing.assert_allclose(result.numpy(), expected, atol=1e-5)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20)
def test_hits_its_points_and_is_linear(seed: int) -> None:
    points = random_points(seed, corners=False)
    interpolant = ScatteredInterpolant(points, SHAPE)
    a, b = torch.rand(2, len(points), generator=torch.Generator().manual_seed(seed))
    result = interpolant(a)
    torch.testing.assert_close(result[points[:, 1], points[:, 0]], a)
    torch.testing.assert_close(interpolant(2 * a - 3 * b), 2 * result - 3 * interpolant(b))
    assert result.min() >= a.min() - 1e-6
    assert result.max() <= a.max() + 1e-6


def test_reproduces_a_plane_inside_the_hull() -> None:
    points = random_points(0)
    plane = points[:, 0] * 0.5 - points[:, 1] * 0.25 + 3
    y, x = torch.meshgrid(torch.arange(SHAPE[0]), torch.arange(SHAPE[1]), indexing="ij")
    result = ScatteredInterpolant(points, SHAPE)(plane)
    torch.testing.assert_close(result, x * 0.5 - y * 0.25 + 3)


@pytest.mark.parametrize(
    "points",
    [[[5, 5]], [[5, 5], [20, 9]], [[2, 3], [4, 6], [6, 9], [8, 12]], [[0, 4], [9, 4], [30, 4]]],
    ids=["one point", "two points", "a slanted line", "a row"],
)
def test_nearest_where_there_is_no_triangle(points: list[list[int]]) -> None:
    where = torch.tensor(points)
    values = torch.arange(len(where)).float()
    result = ScatteredInterpolant(where, SHAPE)(values)
    y, x = torch.meshgrid(torch.arange(SHAPE[0]), torch.arange(SHAPE[1]), indexing="ij")
    distance = (x[..., None] - where[:, 0]) ** 2 + (y[..., None] - where[:, 1]) ** 2
    nearest = torch.gather(distance, 2, result.long()[..., None])[..., 0]
    assert torch.equal(nearest, distance.amin(dim=2))


def test_outside_the_hull_takes_the_nearest_point() -> None:
    points = torch.tensor([[10, 10], [20, 10], [15, 20]])
    result = ScatteredInterpolant(points, SHAPE)(torch.tensor([1.0, 2.0, 3.0]))
    assert result[[0, 0, 30], [0, 42, 15]].tolist() == [1, 2, 3]


def test_batches_and_precision() -> None:
    points = random_points(1)
    values = torch.rand(2, 3, len(points), dtype=torch.float64)
    result = ScatteredInterpolant(points, SHAPE)(values)
    assert result.shape == (2, 3, *SHAPE)
    assert result.dtype == torch.float64
    torch.testing.assert_close(result[1, 2], ScatteredInterpolant(points, SHAPE)(values[1, 2]))


def test_no_points() -> None:
    with pytest.raises(NoMeasurementsError, match="at least one point"):
        ScatteredInterpolant(torch.zeros(0, 2, dtype=torch.int64), SHAPE)


@given(
    height=st.integers(1, 40),
    width=st.integers(1, 40),
    share=st.floats(0.0, 1.0),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60)
def test_push_pull_keeps_values_and_stays_between_them(
    height: int, width: int, share: float, seed: int
) -> None:
    generator = torch.Generator().manual_seed(seed)
    known = torch.rand(height, width, generator=generator) < share
    known[seed % height, seed % width] = True
    values = torch.rand(height, width, generator=generator)
    result = push_pull(values * known, known.float())
    assert torch.equal(result[known], values[known])
    assert result.min() >= values[known].min() - 1e-5
    assert result.max() <= values[known].max() + 1e-5


def test_push_pull_is_near_the_triangulation_of_a_smooth_map() -> None:
    points = random_points(0, 0.2)
    x, y = points.unbind(1)
    known = torch.zeros(SHAPE, dtype=torch.bool)
    known[y, x] = True
    rows, columns = torch.meshgrid(*(torch.arange(n) for n in SHAPE), indexing="ij")
    smooth = torch.sin(columns / 12) + 0.02 * rows
    error = (push_pull(smooth * known, known.float()) - smooth).abs()
    linear = (ScatteredInterpolant(points, SHAPE)(smooth[y, x]) - smooth).abs()
    assert error.mean() < 0.02
    assert error.mean() < 4 * linear.mean() + 0.02


def test_push_pull_of_nothing_is_zero() -> None:
    nothing = torch.zeros(7, 9)
    assert torch.equal(push_pull(nothing, nothing), nothing)
