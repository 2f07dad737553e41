"""Scale and shift: recovered exactly, equal to NumPy's least squares, explicit when they fail."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.core.alignment import fit_scale_shift, ratio_of_means
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


@given(seed=st.integers(0, 1000))
@settings(max_examples=25)
def test_a_symmetric_fit_is_the_same_in_both_directions(seed: int) -> None:
    source, target, mask = random_maps(seed)
    there = fit_scale_shift(source, target, mask, symmetric=True)
    back = fit_scale_shift(target, source, mask, symmetric=True)
    torch.testing.assert_close(there.inverse().scale, back.scale)
    torch.testing.assert_close(there.inverse().shift, back.shift)
    slopes = [
        fit_scale_shift(source, target, mask).scale,
        1 / fit_scale_shift(target, source, mask).scale,
    ]
    torch.testing.assert_close(there.scale.abs(), (slopes[0] * slopes[1]).sqrt())
    torch.testing.assert_close(there.increasing, slopes[0] > 0)


def test_a_range_flattens_a_symmetric_fit_less() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = 0.7 + 3 * torch.rand(1, 4000, generator=generator)
    affine = (depth - 0.7) / 3 + 0.15 * torch.randn(depth.shape, generator=generator)
    least_squares = fit_scale_shift(affine, depth, depth < 2).scale.item()
    symmetric = fit_scale_shift(affine, depth, depth < 2, symmetric=True).scale.item()
    assert least_squares < 1.6
    assert 1.9 < symmetric < 3


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
