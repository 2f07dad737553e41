import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Bool, Float

from steered_marigold.errors import InputError, NoMeasurementsError
from steered_marigold.methods.ip_basic import IpBasicCompleter

DepthMap = Float[np.ndarray, "height width"]
Mask = Bool[np.ndarray, "height width"]


def sample(seed: int, *, fraction: float) -> tuple[DepthMap, Mask]:
    rng = np.random.default_rng(seed)
    shape = (60, 80)
    return rng.uniform(1, 9, shape).astype(np.float32), rng.random(shape) < fraction


def complete(depth: DepthMap, mask: Mask, *, max_depth: float = 100.0) -> DepthMap:
    image = torch.zeros((*depth.shape, 3), dtype=torch.uint8)
    method = IpBasicCompleter(max_depth=max_depth)
    return method.complete(image, torch.from_numpy(depth), torch.from_numpy(mask)).depth[0].numpy()


def windows(values: DepthMap, side: int, mode: str) -> Float[np.ndarray, "area height width"]:
    """The square around each pixel; `mode` says what lies beyond the border."""
    height, width = values.shape
    padded = np.pad(values, side // 2, mode)  # type: ignore[call-overload]
    return np.stack(
        [padded[y : y + height, x : x + width] for y in range(side) for x in range(side)]
    )


def published(depth: DepthMap, mask: Mask) -> DepthMap:
    """The paper's steps with plain windows, for holes that its 31x31 dilation can fill."""
    diamond = [abs(y - 2) + abs(x - 2) <= 2 for y in range(5) for x in range(5)]
    d = np.where(mask, 100 - depth.astype(np.float64), 0)
    d = windows(d, 5, "constant")[diamond].max(0)
    d = windows(windows(d, 5, "constant").max(0), 5, "edge").min(0)
    d = np.where(d > 0, d, windows(d, 7, "constant").max(0))
    for column in d.T:
        filled = np.flatnonzero(column)
        if len(filled):
            column[: filled[0]] = column[filled[0]]
    d = np.where(d > 0, d, windows(d, 31, "constant").max(0))
    assert d.all()
    d = np.median(windows(d, 5, "edge"), axis=0)
    binomial = np.array([1, 4, 6, 4, 1]) / 16
    weights = np.outer(binomial, binomial).ravel()
    return 100 - np.tensordot(weights, windows(d, 5, "reflect"), 1)


@pytest.mark.parametrize("fraction", [0.01, 0.05, 0.5])
def test_equals_the_papers_steps_written_with_plain_windows(fraction: float) -> None:
    depth, mask = sample(0, fraction=fraction)
    np.testing.assert_allclose(complete(depth, mask), published(depth, mask), atol=1e-4)


def test_fills_holes_larger_than_the_largest_kernel() -> None:
    depth = np.full((90, 200), 5, np.float32)
    depth[:, :100] = 2
    mask = np.zeros(depth.shape, bool)
    mask[60:, :10] = mask[60:, 190:] = True
    filled = complete(depth, mask)
    np.testing.assert_allclose(filled[:, :90], 2, atol=1e-4)
    np.testing.assert_allclose(filled[:, 110:], 5, atol=1e-4)


def test_nearer_objects_grow_into_farther_ones() -> None:
    depth = np.full((40, 40), 8, np.float32)
    depth[16:25, 16:25] = 2
    filled = complete(depth, np.ones(depth.shape, bool))
    assert filled[20, 25] < 5.0


@settings(max_examples=20)
@given(seed=st.integers(0, 99), max_depth=st.floats(9.01, 1000))
def test_max_depth_beyond_all_measurements_changes_nothing(seed: int, max_depth: float) -> None:
    depth, mask = sample(seed, fraction=0.05)
    np.testing.assert_allclose(
        complete(depth, mask, max_depth=max_depth), complete(depth, mask), atol=1e-3
    )


def test_measurements_beyond_max_depth_are_missing() -> None:
    depth, mask = sample(1, fraction=0.2)
    np.testing.assert_array_equal(
        complete(depth, mask, max_depth=5.0), complete(depth, mask & (depth < 5), max_depth=5.0)
    )
    with pytest.raises(NoMeasurementsError, match=r"max_depth = 0\.5 m"):
        complete(depth, mask, max_depth=0.5)


@pytest.mark.parametrize("max_depth", [0.0, -1.0, 1e6, float("nan")])
def test_refuses_an_impossible_max_depth(max_depth: float) -> None:
    with pytest.raises(InputError, match="max_depth"):
        IpBasicCompleter(max_depth=max_depth)
