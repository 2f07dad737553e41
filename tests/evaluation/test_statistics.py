import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.errors import InputError
from steered_marigold.evaluation.statistics import bootstrap_interval, paired_comparison

values = st.lists(st.floats(-100, 100), min_size=1, max_size=30)


@settings(max_examples=30)
@given(values, st.floats(-10, 10))
def test_interval_moves_with_the_values(x: list[float], shift: float) -> None:
    low, high = bootstrap_interval(x)
    assert min(x) - 1e-9 <= low <= high <= max(x) + 1e-9
    moved = bootstrap_interval([value + shift for value in x])
    assert moved == pytest.approx((low + shift, high + shift), abs=1e-9)
    assert bootstrap_interval(x) == (low, high)


def test_interval_agrees_with_the_normal_one() -> None:
    x = np.random.default_rng(5).normal(3, 2, 400)
    half = 1.96 * x.std() / 20
    assert bootstrap_interval(list(x)) == pytest.approx(
        (x.mean() - half, x.mean() + half), abs=0.03
    )


def test_interval_covers_the_true_mean_95_times_in_100() -> None:
    rng = np.random.default_rng(6)
    hits = 0
    for _ in range(200):
        low, high = bootstrap_interval(list(rng.exponential(1, 100)))
        hits += low <= 1 <= high
    assert 0.89 <= hits / 200 <= 0.985


@settings(max_examples=30)
@given(values, st.integers(0, 99))
def test_comparison_is_antisymmetric(x: list[float], seed: int) -> None:
    first = {str(frame): value for frame, value in enumerate(x)}
    noise = np.random.default_rng(seed).normal(0, 1, len(x))
    second = {frame: first[frame] + n for frame, n in zip(first, noise, strict=True)}
    one, other = paired_comparison(first, second), paired_comparison(second, first)
    assert one.difference == pytest.approx(-other.difference)
    assert (one.low, one.high) == pytest.approx((-other.high, -other.low))


def test_pairing_sees_what_the_means_hide() -> None:
    rng = np.random.default_rng(7)
    hard = rng.uniform(0, 10, 50)
    first = {str(frame): value for frame, value in enumerate(hard)}
    second = {str(frame): value + rng.normal(0.1, 0.05) for frame, value in enumerate(hard)}
    low, high = bootstrap_interval(list(second.values()))
    assert low < np.mean(hard) < high
    paired = paired_comparison(first, second)
    assert paired.significant
    assert paired.difference == pytest.approx(-0.1, abs=0.03)


@pytest.mark.parametrize(("images", "significant"), [(5, False), (6, True)])
def test_a_handful_of_images_proves_nothing(images: int, significant: bool) -> None:
    first = {str(frame): 1.0 for frame in range(images)}
    second = {str(frame): 2.0 for frame in range(images)}
    assert paired_comparison(first, second).significant == significant


def test_only_shared_images_count() -> None:
    paired = paired_comparison({"a": 1.0, "b": 5.0}, {"b": 3.0, "c": 100.0})
    assert (paired.difference, paired.low, paired.high, paired.images) == (2, 2, 2, 1)
    assert not paired_comparison({"a": 1.0}, {"a": 1.0}).significant


def test_bad_input() -> None:
    with pytest.raises(InputError, match="at least one image"):
        bootstrap_interval([])
    with pytest.raises(InputError, match="both completed"):
        paired_comparison({"a": 1.0}, {"b": 1.0})
