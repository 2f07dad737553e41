"""Distances against scipy's exact transform."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from steered_marigold.core.distance import distance_to


def exact(mask: torch.Tensor, cap: int) -> torch.Tensor:
    distance: torch.Tensor = torch.from_numpy(distance_transform_edt(~mask.numpy())).float()
    return distance.clamp(max=cap)


def random_mask(height: int, width: int, share: float, seed: int) -> torch.Tensor:
    mask = torch.rand(height, width, generator=torch.Generator().manual_seed(seed)) < share
    mask[seed % height, seed % width] = True
    return mask


@given(
    height=st.integers(1, 50),
    width=st.integers(1, 50),
    cap=st.integers(1, 60),
    share=st.sampled_from([0.0, 0.002, 0.02, 0.3]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=80)
def test_exact_up_to_the_cap(height: int, width: int, cap: int, share: float, seed: int) -> None:
    mask = random_mask(height, width, share, seed)
    torch.testing.assert_close(distance_to(mask, cap=cap), exact(mask, cap))


@pytest.mark.parametrize("cap", [180, 181, 600])
def test_far_distances(cap: int) -> None:
    mask = torch.zeros(300, 500, dtype=torch.bool)
    mask[7, 3] = mask[290, 100] = True
    torch.testing.assert_close(distance_to(mask, cap=cap), exact(mask, cap))


@given(
    height=st.integers(1, 120),
    width=st.integers(1, 120),
    step=st.integers(2, 9),
    share=st.sampled_from([0.0, 0.001, 0.01, 0.2]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=80)
def test_blocks_are_off_by_less_than_stated(
    height: int, width: int, step: int, share: float, seed: int
) -> None:
    mask = random_mask(height, width, share, seed)
    distance = distance_to(mask, cap=90, step=step)
    assert (distance - exact(mask, 90)).abs().max() < 1.5 * step
    assert bool((distance[mask] == 0).all())


@pytest.mark.parametrize("step", [1, 4])
def test_nothing_to_be_near_to(step: int) -> None:
    distance = distance_to(torch.zeros(9, 13, dtype=torch.bool), cap=30, step=step)
    assert bool((distance == 30).all())
