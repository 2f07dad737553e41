"""The reference and the package compute the same, each in its own way."""

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks import reference
from benchmarks.runs import reference_models
from steered_marigold.core.anchors import Anchors, far_from_known, select_anchors
from steered_marigold.core.interpolation import ScatteredInterpolant
from steered_marigold.core.steering import normalise_condition, steering_target
from tests.diffusion.conftest import tiny_pipeline

HEIGHT, WIDTH = 48, 64


def measurements(share: float = 0.05) -> tuple[Tensor, Tensor]:
    """(depth [m], mask)."""
    generator = torch.Generator().manual_seed(1)
    depth = 1 + 3 * torch.rand(HEIGHT, WIDTH, generator=generator)
    return depth, torch.rand(HEIGHT, WIDTH, generator=generator) < share


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_both_draw_the_same_positions() -> None:
    mask = measurements(0.01)[1]
    points, known = reference.draw_positions(mask.numpy(), seeded(3))
    anchors = select_anchors(
        mask, far_from_known(mask, 7), anchor_fraction=0.05, generator=seeded(3)
    )
    np.testing.assert_array_equal(points, anchors.points.numpy())
    np.testing.assert_array_equal(known, anchors.known.numpy())
    assert 4 < (~known).sum() < len(points)


def test_two_interpolations_move_a_map_as_one_of_the_residual_does() -> None:
    depth, mask = measurements()
    predicted = torch.rand(1, HEIGHT, WIDTH, generator=seeded(2)) * 2 - 1
    condition = normalise_condition(depth[None], mask[None])
    points, known = reference.draw_positions(mask.numpy(), seeded(3))
    anchors = Anchors(torch.from_numpy(points), torch.from_numpy(known))
    target = steering_target(
        predicted, condition, anchors, ScatteredInterpolant(anchors.points, (HEIGHT, WIDTH))
    )
    c = reference.normalise(depth.double().numpy(), mask.numpy())
    moved = reference.move(predicted[0].double().numpy(), c, points, known)
    np.testing.assert_allclose(target[0].numpy(), moved, atol=1e-5)


@pytest.mark.parametrize("align", [True, False])
def test_preset_paper_is_the_reference(align: bool) -> None:
    pipeline = tiny_pipeline()
    pipeline.set_progress_bar_config(disable=True)
    depth, mask = measurements()
    image = torch.rand(3, HEIGHT, WIDTH, generator=seeded(4))
    generator = seeded(6)
    latents = torch.randn(1, 4, HEIGHT // 8, WIDTH // 8, generator=generator)
    # the pipeline seeds its anchors with what its generator would give next
    anchor_seed = int(torch.randint(2**62, (), generator=generator.clone_state()))
    expected = reference.complete(
        reference_models(pipeline),
        2 * image[None] - 1,
        depth.double().numpy(),
        mask.numpy(),
        latents=latents,
        generator=generator,
        anchor_generator=seeded(anchor_seed),
        align=align,
    )
    answer = pipeline(
        image,
        depth,
        mask,
        preset="paper",
        condition_alignment="least_squares" if align else "minmax",
        generator=seeded(6),
    )
    np.testing.assert_allclose(answer.depth[0].numpy(), expected, atol=1e-4)


def test_equal_measurements_become_a_condition_of_0() -> None:
    depth, mask = np.full((4, 4), 2.0), np.eye(4, dtype=bool)
    assert not reference.normalise(depth, mask).any()


def test_a_falling_fit_gives_way_to_the_ratio_of_means() -> None:
    source, mask = np.array([[1.0, 3.0]]), np.ones((1, 2), dtype=bool)
    np.testing.assert_allclose(reference.fit(source, 5 - source, mask), 1.5 * source)
