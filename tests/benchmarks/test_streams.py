"""The scores of streams by what they mean: exact answers have none, steady ones do not flicker."""

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.streams import HOLES, SEQUENCE_K, View, scores
from steered_marigold.core.frame import Frame


def _views(count: int = 4) -> list[View]:
    """A wall 2 m away, which a camera passes by a pixel a frame."""
    views = []
    for i in range(count):
        depth = torch.full((240, 320), 2.0)
        mask = torch.ones(240, 320, dtype=torch.bool)
        image = torch.zeros((240, 320, 3), dtype=torch.uint8)
        frame = Frame(image=image, sparse_depth=depth, valid_mask=mask, K=SEQUENCE_K)
        pose = torch.eye(4, dtype=torch.float64)
        pose[0, 3] = i * 2.0 / 262.5
        views.append(View(frame, pose, mask))
    return views


def _depths(factors: list[float]) -> list[Tensor]:
    return [torch.full((240, 320), 2.0 * factor) for factor in factors]


@pytest.mark.parametrize("kind", ["blobs", "window", "surface"])
@pytest.mark.parametrize(
    ("factors", "error", "flicker"),
    [
        ([1.0, 1.0, 1.0, 1.0], 0.0, 0.0),
        ([1.1, 1.1, 1.1, 1.1], 0.1, 0.0),
        ([1.0, 1.1, 1.0, 1.1], 0.05, float(np.log(1.1))),
    ],
)
def test_scores_are_what_they_say(
    kind: str, factors: list[float], error: float, flicker: float
) -> None:
    views = _views()
    hidden = list(HOLES[kind](views))
    found = scores(views, hidden, _depths(factors))
    assert found == pytest.approx((error, flicker), abs=1e-5)


def test_flicker_follows_points_of_the_scene() -> None:
    """An error that is painted on the wall moves with it, and does not flicker."""
    views = _views(3)
    hidden = list(HOLES["window"](views))
    stripes = 1 + 0.2 * torch.rand(340, generator=torch.Generator().manual_seed(0))
    painted = [2.0 * stripes[i : i + 320].expand(240, 320) for i in range(3)]
    assert scores(views, hidden, painted)[1] == pytest.approx(0.0, abs=1e-5)
    fixed = [2.0 * stripes[:320].expand(240, 320)] * 3
    assert scores(views, hidden, fixed)[1] > 0.02


def test_dropped_frames_keep_one_in_a_hundred() -> None:
    shares = [float(mask.float().mean()) for mask in HOLES["dropped"](_views(6))]
    assert shares == pytest.approx([0, 0.99, 0.99, 0, 0.99, 0.99], abs=0.002)


def test_a_surface_is_hidden_from_every_side() -> None:
    """The hidden region moves with the wall by a pixel a frame."""
    masks = list(HOLES["surface"](_views(5)))
    assert masks[0].any()
    for i in range(1, 5):
        assert torch.equal(masks[i][:, :-1], masks[i - 1][:, 1:])
