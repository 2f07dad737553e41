"""Steering against a transcription of Eq. 11 with two separate interpolations."""

import numpy as np
import numpy.typing as npt
import pytest
import torch
from scipy.interpolate import griddata

from steered_marigold.core.anchors import far_from_known, select_anchors
from steered_marigold.core.interpolation import ScatteredInterpolant
from steered_marigold.core.steering import (
    Steering,
    align_condition,
    normalise_condition,
    steering_target,
    steering_update,
)

HEIGHT, WIDTH = 48, 64


def scene(pattern: str) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(x0D in [-1, 1], depth [m], known): uniform samples, or the same with the centre erased."""
    generator = torch.Generator().manual_seed(0)
    predicted = torch.rand(1, HEIGHT, WIDTH, generator=generator) * 2 - 1
    depth = torch.rand(1, HEIGHT, WIDTH, generator=generator) * 4 + 1
    known = torch.rand(1, HEIGHT, WIDTH, generator=generator) < 0.05
    if pattern == "erased":
        known[:, 12:36, 12:52] = False
    return predicted, depth, known


def paper_target(
    predicted: npt.NDArray[np.float32],
    condition: npt.NDArray[np.float32],
    positions: npt.NDArray[np.bool_],
    known: npt.NDArray[np.bool_],
) -> npt.NDArray[np.float64]:
    """x0D - phi1(x0D, P) + phi2(x0D, c, P), as printed: two interpolations over P."""
    points = np.flip(np.argwhere(positions), axis=1)
    rows, columns = points[:, 1], points[:, 0]
    grid = tuple(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)))
    from_prediction = predicted[rows, columns].astype(np.float64)
    from_both = np.where(known, condition, predicted)[rows, columns].astype(np.float64)
    phi1 = griddata(points, from_prediction, grid, method="linear")
    phi2 = griddata(points, from_both, grid, method="linear")
    return np.asarray(predicted - phi1 + phi2)


@pytest.mark.parametrize("pattern", ["uniform", "erased"])
def test_target_equals_the_papers_two_interpolations(pattern: str) -> None:
    predicted, depth, known = scene(pattern)
    condition = align_condition(normalise_condition(depth, known), predicted, known)
    far = far_from_known(known[0], 7)
    anchors = select_anchors(
        known[0], far, anchor_fraction=0.05, generator=torch.Generator().manual_seed(1)
    )
    positions = np.zeros((HEIGHT, WIDTH), dtype=bool)
    positions[anchors.points[:, 1], anchors.points[:, 0]] = True
    expected = paper_target(predicted[0].numpy(), condition[0].numpy(), positions, known[0].numpy())
    interpolant = ScatteredInterpolant(anchors.points, (HEIGHT, WIDTH))
    target = steering_target(predicted, condition, anchors, interpolant)
    np.testing.assert_allclose(target[0].numpy(), expected, atol=2e-5)


def test_update_is_equation_11() -> None:
    prev, x0, encoded = torch.rand(3, 1, 4, 6, 8, generator=torch.Generator().manual_seed(0))
    strength = torch.tensor(0.07)
    expected = prev.numpy() + 0.07 * (encoded.numpy() - x0.numpy())
    np.testing.assert_allclose(
        steering_update(prev, x0, encoded, strength).numpy(), expected, atol=1e-6
    )


def test_condition_covers_the_range_of_the_measurements() -> None:
    _, depth, known = scene("uniform")
    condition = normalise_condition(depth, known)
    assert condition[known].min() == -1
    assert condition[known].max() == 1
    assert bool((condition[~known] == 0).all())
    order = depth[known].argsort()
    assert bool((condition[known][order].diff() >= 0).all())


def test_equal_measurements_make_a_zero_condition() -> None:
    _, _, known = scene("uniform")
    condition = normalise_condition(torch.full(known.shape, 2.0), known)
    assert condition.abs().max() == 0


def test_alignment_with_a_falling_fit_uses_the_ratio_of_means() -> None:
    predicted, _, known = scene("uniform")
    condition = torch.where(known, 3.0 - predicted, 0.0)
    aligned = align_condition(condition, predicted, known)
    ratio = predicted[known].double().mean() / condition[known].double().mean()
    torch.testing.assert_close(aligned[known], (condition[known] * ratio).float())


def steering(pattern: str, *, redraw: bool, **changes: object) -> Steering:
    _, depth, known = scene(pattern)
    arguments: dict[str, object] = {
        "neighborhood_px": 7,
        "anchor_fraction": 0.05,
        "max_anchors": None,
        "condition_alignment": "least_squares",
    }
    return Steering(
        depth,
        known,
        redraw=redraw,
        generators=[torch.Generator().manual_seed(1)],
        device=torch.device("cpu"),
        **(arguments | changes),  # type: ignore[arg-type]
    )


def test_measurements_that_the_prediction_meets_change_nothing() -> None:
    predicted, depth, known = scene("erased")
    field = steering("erased", redraw=False)
    condition = normalise_condition(depth, known)
    agreeing = torch.where(known, 0.4 * condition + 0.1, predicted)
    torch.testing.assert_close(field.target(agreeing, 0), agreeing, atol=1e-5, rtol=0)


def test_anchors_are_redrawn_only_if_asked() -> None:
    predicted = scene("erased")[0]
    fixed, redrawn = steering("erased", redraw=False), steering("erased", redraw=True)
    first = redrawn.target(predicted, 0)
    assert torch.equal(fixed.target(predicted, 0), first)
    assert torch.equal(fixed.target(predicted, 1), first)
    assert not torch.equal(redrawn.target(predicted, 1), first)


def test_members_of_one_image_are_steered_alike() -> None:
    predicted = torch.cat([scene("uniform")[0], scene("uniform")[0].flip(2)])
    both = steering("uniform", redraw=False).target(predicted, 0)
    alone = [steering("uniform", redraw=False).target(p[None], 0) for p in predicted]
    torch.testing.assert_close(both, torch.cat(alone))


def test_thinned_measurements_steer_to_nearly_the_same_map() -> None:
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    depth = 2 + 0.02 * x + 0.3 * torch.sin(y / 9)
    known = torch.ones(1, HEIGHT, WIDTH, dtype=torch.bool)
    known[:, 16:32, 20:44] = False
    predicted = (torch.cos(x / 20) * 0.5)[None]
    maps = [
        Steering(
            depth[None],
            known,
            neighborhood_px=7,
            anchor_fraction=0.05,
            redraw=False,
            max_anchors=limit,
            condition_alignment="minmax",
            generators=[torch.Generator().manual_seed(1)],
            device=torch.device("cpu"),
        ).target(predicted, 0)
        for limit in (None, 400)
    ]
    moved = (maps[0] - predicted).abs().mean()
    assert (maps[0] - maps[1]).abs().mean() < 0.05 * moved
