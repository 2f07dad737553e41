"""Which measurements are believed."""

import torch

from steered_marigold.core.outliers import judge_measurements, trusted_measurements

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


def room() -> tuple[torch.Tensor, torch.Tensor]:
    """(a dense depth [m] of a floor, a wall and a box before them, where the box is)."""
    y, x = torch.meshgrid(torch.arange(240), torch.arange(320), indexing="ij")
    depth = torch.minimum(torch.full((240, 320), 4.0), 400 / (y + 1.0)) + 0.002 * x
    box = (y > 60) & (y < 170) & (x > 180) & (x < 270)
    return torch.where(box, 2.2 + 0.001 * x, depth), box


def blurred(depth: torch.Tensor) -> torch.Tensor:
    """As a prediction has it: its edges are ramps."""
    return torch.nn.functional.avg_pool2d(
        depth[None, None], 5, stride=1, padding=2, count_include_pad=False
    )[0, 0]


def everywhere(depth: torch.Tensor) -> torch.Tensor:
    return torch.ones_like(depth, dtype=torch.bool)


def test_a_clean_dense_scene_is_believed() -> None:
    depth, _ = room()
    assert trusted_measurements(blurred(depth), depth, everywhere(depth)).float().mean() > 0.995


def test_connected_false_regions_are_left_out_and_doubted() -> None:
    depth, _ = room()
    wrong = torch.zeros_like(depth, dtype=torch.bool)
    wrong[200:212, 60:80] = True  # a wet floor
    wrong[20:30, 250:262] = True
    measured = torch.where(wrong, depth * 3, depth)
    judged = judge_measurements(blurred(depth), measured, everywhere(depth))
    assert not bool(judged.trusted[wrong].any())
    assert bool(judged.doubted[wrong].all())
    assert judged.trusted[~wrong].float().mean() > 0.995


def test_mixed_pixels_are_left_out() -> None:
    depth, _ = room()
    mixed = blurred(depth)
    flying = (mixed - depth).abs() > 0.15
    measured = torch.where(flying, mixed, depth)
    trusted = trusted_measurements(blurred(depth), measured, everywhere(depth))
    assert int(flying.sum()) > 500
    assert trusted[flying].float().mean() < 0.2
    assert trusted[~flying].float().mean() > 0.99


def test_a_pole_that_the_prior_overlooked_lives() -> None:
    depth, _ = room()
    measured = depth.clone()
    measured[40:200, 100:103] = 1.8
    trusted = trusted_measurements(blurred(depth), measured, everywhere(depth))
    assert trusted[40:200, 100:103].float().mean() > 0.95


def test_a_large_thing_that_the_prior_overlooked_is_believed() -> None:
    depth, box = room()
    without = torch.where(box, torch.full_like(depth, 4.0), depth)
    trusted = trusted_measurements(blurred(without), depth, everywhere(depth))
    assert trusted[box].float().mean() > 0.95


def test_lone_readings_in_glass_are_left_out() -> None:
    depth, _ = room()
    mask = everywhere(depth)
    mask[20:180, 20:120] = False
    mask[100:103, 60:63] = True
    measured = depth.clone()
    measured[100:103, 60:63] = 14.0
    trusted = trusted_measurements(blurred(depth), measured, mask)
    assert not bool(trusted[100:103, 60:63].any())


def test_another_scale_is_judged_alike() -> None:
    depth, _ = room()
    measured = depth.clone()
    measured[200:212, 60:80] *= 3
    once, thrice = (
        trusted_measurements(blurred(depth) * s, measured * s, everywhere(depth)) for s in (1, 7.3)
    )
    assert (once != thrice).float().mean() < 1e-3


def test_something_is_always_believed() -> None:
    mask = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    mask[::20, ::20] = True
    depth = torch.where(torch.arange(WIDTH) % 40 == 0, 0.1, 90.0).expand(HEIGHT, WIDTH)
    prior = torch.full((HEIGHT, WIDTH), 3.0)
    assert bool(trusted_measurements(prior, depth, mask).any())
