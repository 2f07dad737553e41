"""Measurements move to the processing grid as points."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.diffusion.grid import move_to_grid


@given(
    seed=st.integers(0, 1000),
    height=st.integers(3, 20),
    width=st.integers(3, 20),
    pad=st.integers(0, 5),
)
@settings(max_examples=40)
def test_every_cell_holds_its_nearest_measurement(
    seed: int, height: int, width: int, pad: int
) -> None:
    generator = torch.Generator().manual_seed(seed)
    depth = torch.rand(2, 15, 17, generator=generator) + 0.5
    mask = torch.rand(2, 15, 17, generator=generator) < 0.4
    grid, known = move_to_grid(depth, mask, (height, width), (height + pad, width + pad))
    expected: dict[tuple[int, int, int], float] = {}
    for b, y, x in mask.nonzero().tolist():
        cell = (b, (2 * y + 1) * height // 30, (2 * x + 1) * width // 34)
        expected[cell] = min(expected.get(cell, 99.0), float(depth[b, y, x]))
    assert {tuple(c) for c in known.nonzero().tolist()} == set(expected)
    assert all(float(grid[cell]) == value for cell, value in expected.items())
    assert bool((grid[~known] == 0).all())


def test_the_same_grid_changes_nothing() -> None:
    depth = torch.rand(1, 9, 11) + 0.5
    mask = torch.rand(1, 9, 11) < 0.5
    grid, known = move_to_grid(depth, mask, (9, 11), (9, 11))
    assert torch.equal(known, mask)
    assert torch.equal(grid[mask], depth[mask])
