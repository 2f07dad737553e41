"""Which measurements are believed."""

import pytest
import torch

from steered_marigold.core.outliers import (
    ORIGIN,
    fit_scale_shift_robust,
    trusted_measurements,
)
from steered_marigold.errors import NoMeasurementsError

HEIGHT, WIDTH = 60, 80


def scene(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(affine depth in [0, 1], true depth [m], uniform mask)."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    affine = (x / WIDTH * 0.6 + (y > 30) * 0.3 + 0.05).float()
    mask = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(seed)) < 0.2
    return affine, 3 * affine + 0.7, mask


def with_outliers(depth: torch.Tensor, mask: torch.Tensor, share: float) -> torch.Tensor:
    """The mask of replaced measurements; depth is changed in place to 0.3..10 m there."""
    generator = torch.Generator().manual_seed(1)
    wrong = mask & (torch.rand(depth.shape, generator=generator) < share)
    depth[wrong] = torch.rand(depth.shape, generator=generator)[wrong] * 9.7 + 0.3
    return wrong


def test_robust_fit_ignores_a_fifth_of_wrong_measurements() -> None:
    affine, depth, mask = scene()
    with_outliers(depth, mask, 0.2)
    fit = fit_scale_shift_robust(affine[None], depth[None], mask[None])
    assert fit.scale.item() == pytest.approx(3, abs=0.01)
    assert fit.shift.item() == pytest.approx(0.7, abs=0.01)


def test_confidence_weighs_the_robust_fit() -> None:
    affine, depth, mask = scene()
    left = torch.arange(WIDTH) < 60
    depth[:, left] = 5 * affine[:, left] + 0.2
    confidence = torch.where(left, 0.0, 1.0).expand(HEIGHT, WIDTH)
    fit = fit_scale_shift_robust(affine[None], depth[None], mask[None], confidence=confidence[None])
    assert fit.scale.item() == pytest.approx(3, abs=0.01)


def test_one_measurement_puts_the_origin_at_depth_zero() -> None:
    affine = torch.tensor([[[0.2, 0.5, 0.9]]])
    mask = torch.tensor([[[False, True, False]]])
    fit = fit_scale_shift_robust(affine, torch.full_like(affine, 2.4), mask)
    assert fit.apply(affine)[0, 0, 1].item() == pytest.approx(2.4)
    assert fit.apply(torch.tensor([[ORIGIN]])).item() == pytest.approx(0, abs=1e-4)


def test_two_measurements_of_equal_prediction_do_not_run_away() -> None:
    affine = torch.tensor([[0.50, 0.51, 0.0, 1.0]])
    depth = torch.tensor([[2.0, 2.5, 0.0, 0.0]])
    fit = fit_scale_shift_robust(affine, depth, depth > 0)
    near, far = fit.apply(affine)[0, 2:].tolist()
    assert 0.5 < near < 2 < far < 6


def test_the_origin_hardly_moves_the_fit_of_many_measurements() -> None:
    affine, depth, mask = scene()
    source, target, where = affine[None], depth[None] + 1, mask[None]
    fit = fit_scale_shift_robust(source, target, where)
    assert fit.shift.item() == pytest.approx(1.7, abs=0.002)


def test_a_robust_fit_without_measurements_is_an_error() -> None:
    affine, depth, mask = scene()
    with pytest.raises(NoMeasurementsError):
        fit_scale_shift_robust(affine[None], depth[None], mask[None] & False)


def test_clean_measurements_are_believed_even_by_a_poor_prior() -> None:
    _, depth, mask = scene()
    ripple = 1 + 0.2 * torch.sin(torch.arange(WIDTH) / 7)
    trusted = trusted_measurements(depth * ripple, depth, mask)
    assert bool((mask | ~trusted).all())
    assert trusted.sum() / mask.sum() >= 0.99


def test_a_measurement_beside_a_misplaced_edge_is_believed() -> None:
    depth = torch.full((HEIGHT, WIDTH), 4.0) + 0.01 * torch.arange(WIDTH)
    depth[20:40, 30:50] = 1.5
    prior = depth.roll(1, dims=1)
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[::7, 3::7] = True
    mask[:, 29:32] = False
    mask[30, 30] = True  # alone on the object's border, which the prior begins a pixel later
    assert prior[30, 30] > 4
    assert bool(trusted_measurements(prior, depth, mask)[30, 30])
    wrong = depth.clone()
    wrong[30, 30] = 0.8
    assert not bool(trusted_measurements(prior, wrong, mask)[30, 30])


def test_outliers_are_dropped() -> None:
    _, depth, mask = scene()
    prior = depth * (1 + 0.1 * torch.sin(torch.arange(WIDTH) / 7))
    wrong = with_outliers(depth, mask, 0.05)
    trusted = trusted_measurements(prior, depth, mask)
    far_off = wrong & ((depth - prior).abs() > 1)
    assert (trusted & far_off).sum() / far_off.sum() < 0.05
    right = mask & ~wrong
    assert (trusted & right).sum() / right.sum() >= 0.98


def test_a_handful_is_believed() -> None:
    _, depth, _ = scene()
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[[3, 20, 40, 50], [5, 60, 10, 70]] = True
    assert torch.equal(trusted_measurements(depth * 2, depth, mask), mask)
