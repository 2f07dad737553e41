"""From members and measurements to the answer."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.core.completion import join_completions
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import Finishing, finish, without_measurements
from steered_marigold.core.uncertainty import UncertaintyModel

HEIGHT, WIDTH = 48, 64
PLAIN = Finishing(robust=False, consistent=False, least_share=None)
OURS = Finishing(robust=True, consistent=True, least_share=0.02)
CALIBRATED = replace(
    OURS,
    uncertainty=UncertaintyModel(
        near=0.01, reach=0.5, drift=0.2, length=0.03, origin=0.8, moved=0.7, farther=0.3,
        nearer=0.4, relief=10.0, by_kind=(0.8, 1.0, 1.6, 1.6),
    ),
)  # fmt: skip


def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(affine depth in [0, 1], depth [m] = 3 affine + 1, mask)."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    affine = x / WIDTH * 0.7 + 0.1 * torch.sin(y / 9) + 0.15
    mask = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0)) < 0.05
    return affine, 3 * affine + 1, mask


def test_an_exact_prediction_is_recovered_by_both() -> None:
    affine, depth, mask = scene()
    for finishing in (PLAIN, OURS):
        answer = finish(affine[None], depth, mask, finishing, noise=SensorNoise())
        assert (answer.depth[0] - depth).abs().mean() < 0.03
        assert answer.scale is not None
        torch.testing.assert_close(answer.scale, torch.tensor([3.0]), rtol=5e-3, atol=0)
        assert answer.slope_rejected is not None
        assert not answer.slope_rejected.any()


def test_a_falling_slope_is_reported() -> None:
    affine, depth, mask = scene()
    answer = finish(1 - affine[None], depth, mask, PLAIN, noise=SensorNoise())
    assert answer.slope_rejected is not None
    assert answer.slope_rejected.all()
    assert answer.scale is not None
    assert answer.shift is not None
    ratio = depth[mask].mean() / (1 - affine)[mask].mean()
    torch.testing.assert_close(answer.scale[0], ratio)
    assert answer.shift[0] == 0


def test_the_bound_is_a_share_of_the_measured_depth_and_counted() -> None:
    affine, _, mask = scene()
    bounded = replace(PLAIN, least_share=0.5)
    fall = 3 * (affine - 0.4).clamp(min=-0.3) + 1
    answer = finish(affine[None], fall, mask, bounded, noise=SensorNoise())
    least = 0.5 * float(fall[mask].median())
    assert answer.floored is not None
    assert answer.scale is not None
    assert answer.shift is not None
    assert float(answer.depth.min()) == pytest.approx(least)
    below = answer.scale * affine + answer.shift < least
    assert bool(below.any())
    assert torch.equal(answer.floored[0], below)


@pytest.mark.parametrize("kept", ["far", "near"])
def test_beyond_the_measured_range_depth_stays_sane(kept: str) -> None:
    affine, depth, _ = scene()
    noise = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(3))
    seen = depth > 2.8 if kept == "far" else depth < 2.0
    noisy = (affine + 0.1 * (noise - 0.5)).clamp(0, 1)
    answer = finish(noisy[None], depth, seen, OURS, noise=SensorNoise())
    assert answer.floored is not None
    assert not bool(answer.floored.any())
    ratio = (answer.depth[0] / depth)[~seen]
    assert 0.5 < float(ratio.min()) < float(ratio.max()) < 2


def test_depth_beyond_twice_the_measured_range_is_marked() -> None:
    ramp = torch.linspace(0, 1, WIDTH).expand(HEIGHT, WIDTH)
    seen = (ramp > 0.02) & (ramp < 0.1)
    answer = finish(ramp[None], 5 * ramp + 0.5, seen, OURS, noise=SensorNoise())
    assert answer.beyond_range is not None
    farthest = float((5 * ramp + 0.5)[seen].max())
    assert torch.equal(answer.beyond_range[0], answer.depth[0] > 2 * farthest)
    assert bool(answer.beyond_range.any())


@given(scale=st.floats(0.1, 10))
@settings(max_examples=8)
def test_another_scale_changes_nothing_but_scale(scale: float) -> None:
    affine, depth, mask = scene()
    noisy = affine + 0.05 * torch.sin(torch.arange(WIDTH) / 5)
    mask = mask & (depth > 2)
    plain, scaled = (
        finish(noisy[None], depth * s, mask, CALIBRATED, noise=SensorNoise()) for s in (1.0, scale)
    )
    torch.testing.assert_close(scaled.depth, plain.depth * scale, rtol=0.01, atol=0)
    assert plain.uncertainty is not None
    assert scaled.uncertainty is not None
    torch.testing.assert_close(scaled.uncertainty, plain.uncertainty * scale, rtol=0.01, atol=0)
    assert torch.equal(scaled.trusted, plain.trusted)


def test_where_neither_side_can_be_believed_sigma_says_so() -> None:
    affine, depth, _ = scene()
    everywhere = torch.ones_like(depth, dtype=torch.bool)
    measured = depth.clone()
    measured[20:23, 30:34] *= 4
    answer = finish(affine[None], measured, everywhere, CALIBRATED, noise=SensorNoise())
    assert answer.uncertainty is not None
    assert not bool(answer.trusted[0, 20:23, 30:34].any())
    doubtful, sure = answer.uncertainty[0, 20:23, 30:34], answer.uncertainty[0, 30:, :20]
    assert float(doubtful.min()) > 1.0
    assert float(sure.max()) < 0.1
    assert float(answer.uncertainty.min()) > 0


def test_measurements_are_met_exactly_and_outliers_marked() -> None:
    affine, depth, mask = scene()
    given = depth.clone()
    wrong = mask.nonzero()[20]
    given[tuple(wrong)] = 9.5
    answer = finish(affine[None], given, mask, OURS, noise=SensorNoise())
    trusted = answer.trusted[0]
    assert not trusted[tuple(wrong)]
    assert torch.equal(answer.depth[0][trusted], given[trusted])
    assert trusted.sum() >= 0.98 * mask.sum()


def test_records_join_to_a_batch() -> None:
    affine, depth, mask = scene()
    answer = finish(affine[None], depth, mask, OURS, noise=SensorNoise())
    both = join_completions([answer, answer])
    assert both.depth.shape == (2, HEIGHT, WIDTH)
    assert both.scale is not None
    assert both.scale.shape == (2,)
    assert both.uncertainty is None


def test_nothing_measured() -> None:
    affine = scene()[0]
    answer = without_measurements(torch.stack((affine, affine, affine * 0)))
    assert not answer.metric
    assert torch.equal(answer.depth[0], affine)
