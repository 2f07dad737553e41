"""Errors count where depth is known, and nowhere else."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from training.losses import (
    affine_errors,
    aligned,
    gradient_loss,
    mean_over,
    nearness,
    regression_loss,
)


def maps(seed: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Prediction, target and where it is known: two thirds of each image."""
    generator = torch.Generator().manual_seed(seed)
    prediction, target = torch.rand(2, 3, 1, 32, 40, generator=generator) * 2 - 1
    return prediction, target, torch.rand(3, 1, 32, 40, generator=generator) < 0.66


@given(st.integers(0, 1000))
def test_what_is_unknown_changes_no_loss(seed: int) -> None:
    prediction, target, known = maps(seed)
    other = torch.where(known, target, 0.9)
    first = regression_loss(prediction, target, known)
    second = regression_loss(torch.where(known, prediction, -5.0), other, known)
    for name, value in first.items():
        torch.testing.assert_close(value, second[name])


def test_without_holes_the_losses_are_plain_means() -> None:
    prediction, target, known = maps(0)
    everything = torch.ones_like(known)
    error = prediction - target
    total, level = 0.0, error
    for _ in range(4):
        total += float(level.diff(dim=-1).abs().mean() + level.diff(dim=-2).abs().mean())
        level = torch.nn.functional.avg_pool2d(level, 2)
    assert float(gradient_loss(error, everything)) == pytest.approx(total, rel=1e-4)
    torch.testing.assert_close(
        mean_over(error, everything), error.mean(dim=(1, 2, 3), keepdim=True)
    )


def test_alignment_undoes_scale_and_shift_of_what_is_known() -> None:
    _, target, known = maps(1)
    moved = torch.where(known, 0.8 * target - 0.3, 7.0)
    found = aligned(moved, target, known)
    torch.testing.assert_close(found[known], target[known])


def test_near_errors_weigh_more() -> None:
    target = torch.linspace(-1, 1, 50).view(1, 1, 5, 10)
    weight = nearness(target, torch.ones_like(target, dtype=torch.bool))
    assert weight.mean().item() == pytest.approx(1)
    assert (weight.flatten().diff() < 0).all()


def test_affine_errors_of_an_affine_copy_are_none() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = 1 + 3 * torch.rand(1, 20, 30, generator=generator)
    depth[:, :5] = 0
    prediction = torch.where(depth > 0, depth / 7 - 1, 3.0)
    errors = affine_errors(prediction, depth)
    assert errors["abs_rel"] == pytest.approx(0, abs=1e-6)
    assert errors["delta1"] == 1
