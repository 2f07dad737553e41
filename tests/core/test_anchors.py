"""The positions P."""

import cv2
import numpy as np
import pytest
import torch

from steered_marigold.core.anchors import (
    far_from_known,
    neighborhood_ellipse,
    select_anchors,
    thin_measurements,
)


def test_the_papers_ellipse() -> None:
    widths = neighborhood_ellipse(7).sum(axis=1).tolist()
    assert widths == [1, 7, 9, 11, 13, 13, 13, 13, 13, 11, 9, 7, 1]


@pytest.mark.parametrize("neighborhood_px", [1, 2, 3, 5, 7, 10])
def test_far_is_outside_opencvs_dilation(neighborhood_px: int) -> None:
    mask = torch.rand(60, 80, generator=torch.Generator().manual_seed(0)) < 0.01
    side = 2 * neighborhood_px - 1
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    near = cv2.dilate(mask.numpy().astype(np.uint8), ellipse).astype(bool)
    assert np.array_equal(~near, far_from_known(mask, neighborhood_px).numpy())


def test_anchors_are_known_far_and_corner_pixels_in_row_major_order() -> None:
    known = torch.zeros(40, 50, dtype=torch.bool)
    known[10:12, 5:9] = True
    far = far_from_known(known, 7)
    anchors = select_anchors(
        known, far, anchor_fraction=0.1, generator=torch.Generator().manual_seed(0)
    )
    x, y = anchors.points.unbind(1)
    positions = y * 50 + x
    assert bool((positions.diff() > 0).all())
    assert torch.equal(anchors.known, known[y, x])
    corner = ((x == 0) | (x == 49)) & ((y == 0) | (y == 39))
    assert corner.sum() == 4
    assert anchors.known.sum() == 8
    assert bool((anchors.known | far[y, x] | corner).all())
    drawn = len(x) - 8 - 4
    assert 0.1 * int(far.sum()) * 0.6 < drawn <= 200


def test_anchors_depend_on_their_generator_alone() -> None:
    known = torch.zeros(40, 50, dtype=torch.bool)
    far = far_from_known(known, 7)
    first, second = (
        select_anchors(known, far, anchor_fraction=0.05, generator=torch.Generator().manual_seed(s))
        for s in (1, 1)
    )
    other = select_anchors(
        known, far, anchor_fraction=0.05, generator=torch.Generator().manual_seed(2)
    )
    assert torch.equal(first.points, second.points)
    assert not torch.equal(first.points, other.points)


def test_thinning_keeps_one_a_cell_and_the_borders_of_holes() -> None:
    known = torch.ones(80, 120, dtype=torch.bool)
    known[24:56, 40:80] = False
    thinned = thin_measurements(known, 2000)
    assert bool((known | ~thinned).all())
    cells = thinned.view(10, 8, 15, 8).any(dim=3).any(dim=1)
    assert bool((cells | ~known.view(10, 8, 15, 8).any(dim=3).any(dim=1)).all())
    border = known & ~torch.ones_like(known)
    border[23, 40:80] = border[56, 40:80] = border[24:56, 39] = border[24:56, 80] = True
    assert bool(thinned[border].all())
    assert int(thinned.sum()) < int(known.sum()) / 10


@pytest.mark.parametrize("max_anchors", [50, 200])
def test_thinning_respects_its_budget(max_anchors: int) -> None:
    known = torch.rand(80, 120, generator=torch.Generator().manual_seed(0)) < 0.5
    assert int(thin_measurements(known, max_anchors).sum()) <= max_anchors


def test_few_measurements_are_not_thinned() -> None:
    known = torch.rand(80, 120, generator=torch.Generator().manual_seed(0)) < 0.05
    assert torch.equal(thin_measurements(known, 2000), known)
