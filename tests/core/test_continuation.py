"""What a U-Net is told of the measurements."""

import torch
from torch import Tensor

from steered_marigold.core.continuation import known_cells, told_depth

SIZE = (48, 64)


def scene() -> tuple[Tensor, Tensor]:
    """(a prediction in [-1, 1], the depth [m] that it is an affine map of)."""
    y, x = torch.meshgrid(
        torch.linspace(0, 1, SIZE[0]), torch.linspace(0, 1, SIZE[1]), indexing="ij"
    )
    predicted = 1.4 * (0.6 * x + 0.4 * y * y) - 0.7
    return predicted, 2.5 + 1.5 * predicted


def some(share: float) -> Tensor:
    return torch.rand(*SIZE, generator=torch.Generator().manual_seed(0)) < share


def test_a_prediction_that_is_right_is_told_as_it_is() -> None:
    predicted, depth = scene()
    told, trusted = told_depth(predicted, depth, some(0.2))
    torch.testing.assert_close(told, predicted, atol=2e-3, rtol=0)
    assert torch.equal(trusted, some(0.2))


def test_measurements_are_told_in_the_units_of_the_prediction() -> None:
    predicted, depth = scene()
    step = torch.zeros(SIZE)
    step[10:30, 20:40] = 0.2  # a box that the prediction overlooked
    told, _ = told_depth(predicted, depth + 1.5 * step, some(0.3))
    inside = torch.zeros(SIZE, dtype=torch.bool)
    inside[14:26, 24:36] = True
    torch.testing.assert_close(told[inside], (predicted + step)[inside], atol=0.02, rtol=0)


def test_a_wrong_measurement_is_not_told() -> None:
    predicted, depth = scene()
    mask = some(0.2)
    y, x = mask.nonzero()[100]
    wrong = depth.clone()
    wrong[y, x] = 9.0
    told, trusted = told_depth(predicted, wrong, mask)
    assert not trusted[y, x]
    torch.testing.assert_close(told, predicted, atol=0.02, rtol=0)


def test_one_measurement_and_a_prediction_without_shape_are_enough() -> None:
    mask = torch.zeros(SIZE, dtype=torch.bool)
    mask[5, 7] = True
    for predicted in (scene()[0], torch.full(SIZE, -1.0)):
        told, trusted = told_depth(predicted, torch.full(SIZE, 2.0), mask)
        assert torch.isfinite(told).all()
        assert torch.equal(trusted, mask)


def test_a_cell_is_known_if_all_of_it_is_near_a_measurement() -> None:
    mask = torch.zeros(SIZE, dtype=torch.bool)
    mask[4, 4] = mask[28, 47] = True  # the middle of a cell, and the border of another
    known = known_cells(mask, cell=8)
    assert known.shape == (6, 8)
    assert known.nonzero().tolist() == [[0, 0]]
    assert known_cells(torch.ones(SIZE, dtype=torch.bool), cell=8).all()
