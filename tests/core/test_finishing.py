"""From members and measurements to the answer."""

import torch

from steered_marigold.core.completion import join_completions
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import Finishing, finish, without_measurements

HEIGHT, WIDTH = 48, 64
PLAIN = Finishing(robust=False, consistent=False, minimum_depth=None)
OURS = Finishing(robust=True, consistent=True, minimum_depth=0.05)


def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(affine depth in [0, 1], depth [m] = 3 affine + 1, mask)."""
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    affine = x / WIDTH * 0.7 + 0.1 * torch.sin(y / 9) + 0.15
    mask = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0)) < 0.05
    return affine, 3 * affine + 1, mask


def test_an_exact_prediction_is_recovered_by_both() -> None:
    affine, depth, mask = scene()
    for settings in (PLAIN, OURS):
        answer = finish(affine[None], depth, mask, settings, noise=SensorNoise())
        assert (answer.depth[0] - depth).abs().mean() < 0.03
        assert answer.scale is not None
        torch.testing.assert_close(answer.scale, torch.tensor([3.0]), rtol=1e-3, atol=1e-3)
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


def test_the_floor_is_kept_and_counted() -> None:
    affine, depth, mask = scene()
    near = torch.where(mask, depth - 0.99, 0.0)
    near = torch.where(near > 0, near, 0.0)
    few = mask & (near > 1.0)
    answer = finish(affine[None], near, few, OURS, noise=SensorNoise())
    assert answer.floored is not None
    assert answer.scale is not None
    assert answer.shift is not None
    assert bool((answer.depth > 0).all())
    below = answer.scale * affine + answer.shift < 0.05
    assert torch.equal(answer.floored[0], below)


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
