"""Measurements move to the image's grid as points."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.core.registration import register_depth
from steered_marigold.errors import SizeMismatchError


def _sensor(rows: int, columns: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    depth = 1 + torch.rand(rows, columns, generator=generator)
    return depth, torch.rand(rows, columns, generator=generator) < 0.7


@given(
    rows=st.integers(1, 12),
    columns=st.integers(1, 12),
    up=st.integers(1, 5),
    seed=st.integers(0, 9),
)
def test_no_measurement_is_lost_changed_or_invented_on_a_finer_grid(
    rows: int, columns: int, up: int, seed: int
) -> None:
    depth, mask = _sensor(rows, columns, seed)
    moved = register_depth(depth, mask, (rows * up, columns * up))
    assert torch.equal(moved.depth[moved.valid_mask].sort()[0], depth[mask].sort()[0])
    assert torch.equal(moved.depth > 0, moved.valid_mask)
    if up % 2:  # the middle of an odd block
        centre = slice(up // 2, None, up)
        assert torch.equal(moved.valid_mask[centre, centre], mask)


@given(
    rows=st.integers(4, 20),
    columns=st.integers(4, 20),
    down=st.sampled_from([2, 3, 4]),
    seed=st.integers(0, 9),
)
def test_each_pixel_holds_the_nearest_of_its_measurements(
    rows: int, columns: int, down: int, seed: int
) -> None:
    """Plain loops, from the definition, on a coarser image."""
    depth, mask = _sensor(rows * down, columns * down, seed)
    moved = register_depth(depth, mask, (rows, columns))
    for y in range(rows):
        for x in range(columns):
            block = (slice(y * down, (y + 1) * down), slice(x * down, (x + 1) * down))
            values = depth[block][mask[block]]
            assert bool(moved.valid_mask[y, x]) == (len(values) > 0)
            if len(values):
                assert moved.depth[y, x] == values.min()


def test_an_equal_grid_changes_nothing() -> None:
    depth, mask = _sensor(7, 9, 0)
    moved = register_depth(depth, mask, (7, 9))
    assert torch.equal(moved.valid_mask, mask)
    assert torch.equal(moved.depth, torch.where(mask, depth, 0.0))


def test_other_maps_move_with_the_measurement_that_won() -> None:
    depth = torch.tensor([[3.0, 1.0], [2.0, 5.0]])
    mask = torch.tensor([[True, True], [True, False]])
    confidence = torch.tensor([[0.1, 0.2], [0.3, 0.4]])
    moved = register_depth(depth, mask, (1, 1))
    assert moved.depth.item() == 1
    assert moved.carry(confidence).item() == pytest.approx(0.2)
    empty = register_depth(depth, torch.zeros_like(mask), (4, 4))
    assert not empty.valid_mask.any()
    assert not empty.carry(confidence).any()


def test_sizes_that_only_rounding_separates_agree() -> None:
    for sensor, image in (((192, 256), (1440, 1920)), ((187, 620), (375, 1241))):
        depth, mask = _sensor(*sensor, 0)
        assert register_depth(depth, mask, image).depth.shape == image


@pytest.mark.parametrize("size", [(480, 640), (192, 192), (1920, 1440)])
def test_another_aspect_ratio_is_refused(size: tuple[int, int]) -> None:
    depth, mask = _sensor(171, 224, 0)
    with pytest.raises(SizeMismatchError, match=r"224x171.*aspect ratio"):
        register_depth(depth, mask, size)
