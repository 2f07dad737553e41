"""librealsense's filters against plain loops over pixels, written from their definition."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Float

from steered_marigold.methods.hole_filling import (
    HoleFillingFilter,
    Mode,
    SpatialFilter,
    fill_holes,
    smooth,
)

DepthMap = Float[np.ndarray, "height width"]


def with_holes(seed: int, share: float, *, low: int, high: int) -> DepthMap:
    """Whole numbers from `low` to `high`, this share of them holes."""
    rng = np.random.default_rng(seed)
    depth = rng.integers(low, high, (13, 17))
    return np.where(rng.random(depth.shape) < share, 0, depth).astype(np.float32)


def filled_from_the_left(depth: DepthMap) -> DepthMap:
    filled = depth.copy()
    for y, x in np.ndindex(*depth.shape):
        if x > 0 and filled[y, x] == 0:
            filled[y, x] = filled[y, x - 1]
    return filled


def filled_from_around(depth: DepthMap, choose: Callable[[float, list[float]], float]) -> DepthMap:
    filled = depth.copy()
    height, width = depth.shape
    for y in range(1, height - 1):
        for x in range(1, width):
            if filled[y, x] == 0:
                others = [filled[y - 1, x - 1], filled[y, x - 1], filled[y + 1, x - 1]]
                filled[y, x] = choose(filled[y - 1, x], [*others, filled[y + 1, x]])
    return filled


def farthest(above: float, others: list[float]) -> float:
    return max(above, *others)


def nearest(above: float, others: list[float]) -> float:
    for other in others:
        if other > 0 and other < above:
            above = other
    return above


REFERENCES: dict[Mode, Callable[[DepthMap], DepthMap]] = {
    "left": filled_from_the_left,
    "farthest": lambda depth: filled_from_around(depth, farthest),
    "nearest": lambda depth: filled_from_around(depth, nearest),
}


@pytest.mark.parametrize("mode", REFERENCES)
@given(seed=st.integers(0, 999), share=st.sampled_from([0.1, 0.6, 0.95]))
def test_holes_are_filled_as_in_a_loop(mode: Mode, seed: int, share: float) -> None:
    depth = with_holes(seed, share, low=300, high=9000) / np.float32(1000)
    np.testing.assert_array_equal(fill_holes(depth, mode), REFERENCES[mode](depth))


def average(here: float, before: float) -> float:
    return (here + before + 1) // 2


def smoothed(depth_mm: DepthMap, *, rounds: int = 2, edge_mm: int = 20, radius: int) -> DepthMap:
    """Line by line, pixel by pixel."""
    image = depth_mm.copy()
    height, width = image.shape
    for _ in range(rounds):
        for row in image:
            for order in (range(1, width - 1), range(width - 2, -1, -1)):
                step, holes = order.step, 0
                for x in order:
                    before = row[x - step]
                    if before == 0:
                        continue
                    if row[x] > 0:
                        holes = 0
                        if abs(row[x] - before) <= edge_mm:
                            row[x] = average(row[x], before)
                    else:
                        holes += 1
                        if holes < radius:
                            row[x] = before
        for order in (range(1, height), range(height - 2, -1, -1)):
            for y in order:
                for x in range(width):
                    here, before = image[y, x], image[y - order.step, x]
                    if here > 0 and before > 0 and abs(here - before) < edge_mm:
                        image[y, x] = average(here, before)
    return image


@given(
    seed=st.integers(0, 999),
    share=st.sampled_from([0.1, 0.6, 0.95]),
    high=st.sampled_from([1040, 9000]),
)
def test_rows_and_columns_are_smoothed_as_in_a_loop(seed: int, share: float, high: int) -> None:
    depth = with_holes(seed, share, low=1000, high=high)
    np.testing.assert_array_equal(smooth(depth), smoothed(depth, radius=255))


def test_a_hole_wider_than_four_radii_stays_open() -> None:
    depth = np.zeros((3, 1100), np.float32)
    depth[1, 0], depth[1, -1] = 1000, 2000
    answer = smooth(depth)
    np.testing.assert_array_equal(answer, smoothed(depth, radius=255))
    assert (answer[1] == 0).any()
    assert not answer[[0, 2]].any()


@pytest.mark.parametrize("method", [HoleFillingFilter("nearest"), SpatialFilter()])
def test_what_a_filter_leaves_open_comes_from_its_nearest_pixel(
    method: HoleFillingFilter | SpatialFilter,
) -> None:
    depth, mask = torch.zeros(7, 9), torch.zeros(7, 9, dtype=torch.bool)
    depth[5, 7], mask[5, 7] = 2.5, True
    answer = method.complete(torch.zeros(7, 9, 3, dtype=torch.uint8), depth, mask)
    torch.testing.assert_close(answer.depth, torch.full((1, 7, 9), 2.5))


def test_the_nearest_surface_grows_and_the_farthest_gives_way() -> None:
    depth = torch.full((9, 12), 4.0)
    depth[:, 6:] = 1.0
    mask = torch.ones(9, 12, dtype=torch.bool)
    mask[3:6, 4:8] = False
    image = torch.zeros(9, 12, 3, dtype=torch.uint8)
    near, far = (
        HoleFillingFilter(mode).complete(image, depth, mask).depth[0]
        for mode in ("nearest", "farthest")
    )
    assert (far[3:6, 4:8] == 4).all()
    assert near[3:6, 4:8].mean() < 3
