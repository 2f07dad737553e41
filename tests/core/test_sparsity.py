from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from steered_marigold.core.frame import Frame
from steered_marigold.core.sparsity import (
    add_noise,
    add_outliers,
    erase_rectangle,
    fraction_to_count,
    limit_range,
    remove_blobs,
    remove_region,
    sample_uniform,
    scan_lines,
)
from steered_marigold.errors import InputError

SIZE = (60, 80)
Step = Callable[[Frame, torch.Generator], Frame]

STEPS: dict[str, Step] = {
    "uniform": lambda m, g: sample_uniform(m, 200, generator=g),
    "rectangle": lambda m, g: erase_rectangle(m, slice(10, 30), slice(20, 50)),
    "range": lambda m, g: limit_range(m, 3.0),
    "lines": lambda m, g: scan_lines(m, 8, generator=g),
    "blobs": lambda m, g: remove_blobs(m, 3, generator=g),
    "region": lambda m, g: remove_region(m, 1 / 3, generator=g),
    "noise": lambda m, g: add_noise(m, 0.1, generator=g),
    "outliers": lambda m, g: add_outliers(m, 0.05, generator=g),
}


def rng(seed: int = 99) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def dense(seed: int = 0, share: float = 0.8) -> Frame:
    """A random depth map of 0.5 to 6 m, invalid pixels holding values that must not be read."""
    depth = 0.5 + 5.5 * torch.rand(SIZE, generator=rng(seed))
    return frame_of(depth, torch.rand(SIZE, generator=rng(seed + 1)) < share)


def frame_of(depth: torch.Tensor, mask: torch.Tensor) -> Frame:
    """Measurements of a black image."""
    image = torch.zeros(*SIZE, 3, dtype=torch.uint8)
    return Frame(image=image, sparse_depth=depth, valid_mask=mask)


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS.keys())
def test_no_step_invents_leaks_or_varies(step: Step) -> None:
    before = dense()
    after = step(before, rng(7))
    assert not bool((after.valid_mask & ~before.valid_mask).any())
    assert bool((after.sparse_depth[~after.valid_mask] == 0).all())
    assert bool((after.sparse_depth[after.valid_mask] > 0).all())
    again = step(before, rng(7))
    assert torch.equal(after.sparse_depth, again.sparse_depth)
    assert torch.equal(before.sparse_depth, dense().sparse_depth)


@pytest.mark.parametrize("name", ["uniform", "rectangle", "range", "lines", "blobs", "region"])
def test_what_is_kept_keeps_its_value(name: str) -> None:
    before = dense()
    after = STEPS[name](before, rng())
    assert torch.equal(after.sparse_depth[after.valid_mask], before.sparse_depth[after.valid_mask])
    assert 0 < int(after.valid_mask.sum()) < int(before.valid_mask.sum())


@given(st.integers(0, 6000), st.integers(0, 2**31))
def test_uniform_draws_the_count_or_all(count: int, seed: int) -> None:
    before = dense()
    after = sample_uniform(before, count, generator=rng(seed))
    assert int(after.valid_mask.sum()) == min(count, int(before.valid_mask.sum()))


def test_uniform_is_uniform() -> None:
    before = dense(share=1.1)
    hits = sum(
        sample_uniform(before, 480, generator=rng(seed)).valid_mask.int() for seed in range(400)
    )
    assert isinstance(hits, torch.Tensor)
    # 400 draws with probability 0.1: mean 40, standard deviation 6
    assert hits.float().mean() == pytest.approx(40)
    assert hits.float().std() == pytest.approx(6, rel=0.1)


def test_paper_sample_count() -> None:
    assert fraction_to_count(0.05, (448, 608)) == 13619


def test_rectangle_is_empty_and_only_it() -> None:
    after = erase_rectangle(dense(share=1.1), slice(10, 30), slice(20, 50))
    assert not bool(after.valid_mask[10:30, 20:50].any())
    assert int((~after.valid_mask).sum()) == 20 * 30


def test_range() -> None:
    before = dense()
    after = limit_range(before, 3.0)
    assert torch.equal(after.valid_mask, before.valid_mask & (before.sparse_depth <= 3))


@given(st.integers(1, 60), st.integers(0, 2**31))
def test_scan_lines_are_whole_and_evenly_spaced(lines: int, seed: int) -> None:
    after = scan_lines(dense(share=1.1), lines, generator=rng(seed))
    rows = after.valid_mask.all(dim=1).nonzero()[:, 0]
    assert torch.equal(rows, after.valid_mask.any(dim=1).nonzero()[:, 0])
    assert len(rows) == lines
    if lines > 1:
        gaps = rows.diff()
        assert int(gaps.max() - gaps.min()) <= 1


def test_blobs_are_large_and_differ_by_seed() -> None:
    before = dense(share=1.1)
    removed = [1 - remove_blobs(before, 1, generator=rng(s)).valid_mask.float() for s in range(50)]
    shares = torch.stack(removed).mean(dim=(1, 2))
    # half axes of 10 to 30 % of 60 px: 113 to 1018 px of 4800, less where cut by the border
    assert 0.02 < float(shares.mean()) < 0.15
    assert float(shares.max()) < 0.22
    assert len(set(shares.tolist())) > 40


def grid() -> Frame:
    """Three of four pixels of two of three rows, in an L; and an island of 8 x 8 px."""
    mask = torch.zeros(SIZE, dtype=torch.bool)
    mask[5:50, 5:25] = mask[35:50, 5:60] = True
    mask[::3] = False
    mask[:, ::4] = False
    mask[10:18, 60:68] = True
    return frame_of(torch.ones(SIZE), mask)


@given(st.integers(0, 2**31), st.sampled_from([0.1, 1 / 3, 0.7]))
def test_region_is_connected_and_a_share_of_the_largest_area(seed: int, share: float) -> None:
    before = grid()
    after = remove_region(before, share, generator=rng(seed))
    hidden = (before.valid_mask & ~after.valid_mask).numpy()
    assert hidden.sum() == round(share * (int(before.valid_mask.sum()) - 64))
    assert not hidden[10:18, 60:68].any()
    # dilation by 2 bridges the gaps of the grid, of one pixel, and no more than 4
    _, parts = ndimage.label(ndimage.binary_dilation(hidden, np.ones((5, 5))), np.ones((3, 3)))
    assert parts == 1


def test_regions_lie_everywhere() -> None:
    before = dense(share=1.1)
    hidden = torch.stack(
        [~remove_region(before, 1 / 3, generator=rng(seed)).valid_mask for seed in range(40)]
    )
    assert bool(hidden.any(dim=0).all())
    assert not bool(hidden.all(dim=0).any())


def test_a_region_goes_around_what_was_not_measured() -> None:
    """Two arms side by side, joined at one end: the other arm is near, but not next."""
    mask = torch.zeros(SIZE, dtype=torch.bool)
    mask[5:9, 5:75] = mask[20:24, 5:75] = mask[5:24, 5:9] = True
    before = frame_of(torch.ones(SIZE), mask)
    for seed in range(20):
        hidden = mask & ~remove_region(before, 0.2, generator=rng(seed)).valid_mask
        arms = hidden[:9, 20:].any(), hidden[20:, 20:].any()
        assert not all(arms)


def test_nothing_measured_stays_nothing() -> None:
    nothing = dense().keep(torch.zeros(SIZE, dtype=torch.bool))
    after = remove_region(nothing, 1 / 3, generator=rng())
    assert not bool(after.valid_mask.any())


def test_noise_is_relative() -> None:
    before = dense(share=1.1)
    after = add_noise(before, 0.1, generator=rng())
    relative = (after.sparse_depth / before.sparse_depth - 1)[after.valid_mask]
    assert relative.std() == pytest.approx(0.1, rel=0.05)
    assert relative.mean() == pytest.approx(0, abs=0.005)
    near = before.sparse_depth < 2
    assert relative[near[after.valid_mask]].std() == pytest.approx(0.1, rel=0.1)


def test_noise_drops_what_is_no_depth() -> None:
    before = dense(share=1.1)
    after = add_noise(before, 1.0, generator=rng())
    # a standard normal is below -1 with probability 0.159
    assert float((~after.valid_mask).float().mean()) == pytest.approx(0.159, abs=0.02)


def test_outliers_hit_their_share() -> None:
    before = dense()
    after = add_outliers(before, 0.25, generator=rng())
    changed = (after.sparse_depth != before.sparse_depth) & before.valid_mask
    assert int(changed.sum()) == round(0.25 * int(before.valid_mask.sum()))
    assert torch.equal(after.valid_mask, before.valid_mask)
    assert 0.3 <= float(after.sparse_depth[changed].min()) < 0.4
    assert 9.9 < float(after.sparse_depth[changed].max()) <= 10
    assert torch.equal(
        add_outliers(before, 0.0, generator=rng()).sparse_depth,
        before.keep(before.valid_mask).sparse_depth,
    )


def test_bad_input() -> None:
    with pytest.raises(InputError, match="fraction of samples"):
        fraction_to_count(0.0, SIZE)
    with pytest.raises(InputError, match="scan lines"):
        scan_lines(dense(), 61, generator=rng())
    with pytest.raises(InputError, match="fraction of a region"):
        remove_region(dense(), 1.0, generator=rng())
    with pytest.raises(InputError, match="outliers"):
        add_outliers(dense(), 1.5, generator=rng())
