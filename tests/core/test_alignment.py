"""Scale and shift: recovered exactly, equal to NumPy's least squares, explicit when they fail."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.core.alignment import (
    ORIGIN,
    ORIGINS,
    fit_positive,
    fit_scale_shift,
    ratio_of_means,
)
from steered_marigold.errors import NoMeasurementsError

finite = st.floats(-50, 50).filter(lambda v: v == 0 or abs(v) > 1e-3)


def random_maps(seed: int, batch: int = 2) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    source = torch.rand(batch, 6, 7, generator=generator)
    target = torch.rand(batch, 6, 7, generator=generator) * 5
    mask = torch.rand(batch, 6, 7, generator=generator) < 0.5
    mask[:, 0, :2] = True
    return source, target, mask


@given(seed=st.integers(0, 1000), scale=finite, shift=finite)
@settings(max_examples=50)
def test_recovers_any_scale_and_shift(seed: int, scale: float, shift: float) -> None:
    source, _, mask = random_maps(seed)
    target = source.double() * scale + shift
    fit = fit_scale_shift(source.double(), target, mask)
    torch.testing.assert_close(fit.scale, torch.full((2,), scale).double(), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(fit.apply(source.double()), target, rtol=1e-6, atol=1e-6)
    assert fit.increasing.tolist() == [scale > 0] * 2 or abs(scale) < 1e-6


@given(seed=st.integers(0, 1000))
@settings(max_examples=25)
def test_equals_numpy_least_squares_with_weights(seed: int) -> None:
    source, target, mask = random_maps(seed)
    weights = torch.rand(source.shape, generator=torch.Generator().manual_seed(seed)) + 0.1
    fit = fit_scale_shift(source, target, mask, weights=weights)
    for i in range(2):
        x, y = source[i][mask[i]].double().numpy(), target[i][mask[i]].double().numpy()
        root = np.sqrt(weights[i][mask[i]].double().numpy())
        design = np.stack((x, np.ones_like(x)), axis=1) * root[:, None]
        expected = np.linalg.lstsq(design, y * root, rcond=None)[0]
        np.testing.assert_allclose([fit.scale[i], fit.shift[i]], expected, rtol=1e-6, atol=1e-8)


def test_inverse_undoes_the_map() -> None:
    source, target, mask = random_maps(3)
    fit = fit_scale_shift(source, target, mask)
    torch.testing.assert_close(fit.inverse().apply(fit.apply(source)), source)


def test_values_outside_the_mask_do_not_matter() -> None:
    source, target, mask = random_maps(4)
    spoiled = torch.where(mask, target, torch.nan)
    torch.testing.assert_close(
        fit_scale_shift(source, spoiled, mask).scale, fit_scale_shift(source, target, mask).scale
    )


def test_one_distinct_value_gives_scale_only() -> None:
    source, target = torch.full((1, 4), 0.5), torch.tensor([[1.0, 2.0, 3.0, 4.0]])
    fit = fit_scale_shift(source, target, torch.ones(1, 4, dtype=torch.bool))
    assert fit.scale.tolist() == [5.0]
    assert fit.shift.tolist() == [0.0]


def test_a_constant_zero_source_keeps_its_scale() -> None:
    fit = fit_scale_shift(torch.zeros(1, 3), torch.full((1, 3), 2.0), torch.ones(1, 3).bool())
    assert (fit.scale.tolist(), fit.shift.tolist()) == ([1.0], [2.0])


def test_a_falling_fit_is_visible() -> None:
    source = torch.tensor([[0.0, 1.0, 2.0]])
    fit = fit_scale_shift(source, -source, torch.ones(1, 3, dtype=torch.bool))
    assert not fit.increasing
    assert fit.scale.tolist() == [-1.0]


def test_ratio_of_means() -> None:
    mask = torch.tensor([[True, True, False]])
    fit = ratio_of_means(torch.tensor([[1.0, 3.0, 9.0]]), torch.tensor([[2.0, 6.0, 0.0]]), mask)
    assert (fit.scale.tolist(), fit.shift.tolist()) == ([2.0], [0.0])


@pytest.mark.parametrize("fit", [fit_scale_shift, ratio_of_means])
def test_no_measurements(fit: object) -> None:
    assert callable(fit)
    empty = torch.zeros(2, 3, dtype=torch.bool)
    empty[0] = True
    with pytest.raises(NoMeasurementsError, match="at least one measurement"):
        fit(torch.rand(2, 3), torch.rand(2, 3), empty)


def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(affine depth in [0, 1], depth [m] = 3 affine + 1.2, a fifth of the pixels)."""
    y, x = torch.meshgrid(torch.arange(60), torch.arange(80), indexing="ij")
    affine = x / 80 * 0.6 + (y > 30) * 0.3 + 0.05
    mask = torch.rand(60, 80, generator=torch.Generator().manual_seed(0)) < 0.2
    return affine, 3 * affine + 1.2, mask


def test_positive_fit_finds_scale_and_shift_among_wrong_measurements() -> None:
    affine, depth, mask = scene()
    generator = torch.Generator().manual_seed(1)
    wrong = torch.rand(depth.shape, generator=generator) < 0.15
    spoiled = torch.where(wrong, 0.3 + 9.7 * torch.rand(depth.shape, generator=generator), depth)
    fit = fit_positive(affine[None], spoiled, mask).map
    torch.testing.assert_close(fit.apply(affine[None])[0], depth, rtol=0.02, atol=0)


def test_positive_fit_reads_what_confidence_says() -> None:
    affine, depth, mask = scene()
    left = (torch.arange(80) < 60).expand(60, 80)
    spoiled = torch.where(left, 5 * affine + 0.2, depth)
    confidence = torch.where(left, 0.0, 1.0)
    fit = fit_positive(affine[None], spoiled, mask, confidence=confidence).map
    torch.testing.assert_close(fit.apply(affine[None])[0][~left], depth[~left], rtol=0.02, atol=0)
    with pytest.raises(NoMeasurementsError):
        fit_positive(affine[None], depth, mask, confidence=torch.zeros_like(depth))


def test_one_measurement_leaves_the_origin_to_the_prior() -> None:
    affine = torch.tensor([[0.2, 0.5, 0.9]])
    mask = torch.tensor([False, True, False])
    fit = fit_positive(affine, torch.full((3,), 2.4), mask).map
    assert fit.apply(affine)[0, 1].item() == pytest.approx(2.4)
    assert (fit.shift / fit.scale).item() == pytest.approx(ORIGIN, rel=0.05)


@pytest.mark.parametrize("far", [True, False])
def test_depth_beyond_the_measured_range_is_positive_and_doubted(far: bool) -> None:
    affine, depth, _ = scene()
    generator = torch.Generator().manual_seed(2)
    noisy = affine + 0.03 * torch.randn(affine.shape, generator=generator)
    kept = depth > 2.8 if far else depth < 2.0
    fit = fit_positive(noisy[None], depth, kept)
    answer = fit.map.apply(affine[None])[0]
    assert float(answer.min()) > 0
    ratio = (answer / depth)[~kept]
    assert 0.6 < float(ratio.min()) <= float(ratio.max()) < 1.6
    doubt = fit.doubt(affine[None])[0]
    assert float(doubt[~kept].mean()) > 2 * float(doubt[kept].mean())


def test_a_prediction_that_runs_backwards_becomes_flatter_and_never_turns() -> None:
    affine, depth, mask = scene()
    fit = fit_positive(1 - affine[None], depth, mask).map
    assert bool(fit.increasing.all())
    right = fit_positive(affine[None], depth, mask).map
    assert float(fit.shift / fit.scale) > 1.2 * float(right.shift / right.scale)


@given(scale=st.floats(0.1, 10))
@settings(max_examples=10)
def test_another_scale_changes_the_scale_alone(scale: float) -> None:
    affine, depth, mask = scene()
    plain, scaled = (fit_positive(affine[None], depth * s, mask) for s in (1.0, scale))
    torch.testing.assert_close(scaled.map.scale, plain.map.scale * scale, rtol=1e-5, atol=0)
    torch.testing.assert_close(scaled.map.shift, plain.map.shift * scale, rtol=1e-5, atol=0)
    torch.testing.assert_close(scaled.weights, plain.weights, rtol=1e-4, atol=1e-6)


def test_doubt_against_the_definition() -> None:
    affine, depth, mask = scene()
    fit = fit_positive(torch.stack((affine, affine**2)), depth, mask)
    values = torch.tensor([[0.0, 0.25], [0.5, 1.0]])  # on the table's nodes
    for row in range(2):
        logs = fit.log_scales[row, :, None] + (values[row].double() + ORIGINS[:, None]).log()
        mean = (fit.weights[row, :, None] * logs).sum(0)
        spread = (fit.weights[row, :, None] * (logs - mean) ** 2).sum(0).sqrt()
        torch.testing.assert_close(fit.doubt(values)[row].double(), spread, rtol=1e-4, atol=1e-6)
