"""Undistortion against OpenCV's formula, written out."""

import numpy as np
import pytest
import torch

from steered_marigold.errors import InputError
from steered_marigold.io.undistortion import undistort_depth, undistort_image

K = torch.tensor([[60.0, 0, 39.5], [0, 62.0, 29.5], [0, 0, 1]])
DISTORTION = (-0.2, 0.05, 0.002, -0.001, 0.01)


def _place(u: int, v: int) -> tuple[float, float]:
    """Where the lens moves the ray of the pixel (u, v)."""
    k1, k2, p1, p2, k3 = DISTORTION
    x, y = (u - 39.5) / 60, (v - 29.5) / 62
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return 60 * xd + 39.5, 62 * yd + 29.5


def test_depth_is_taken_from_the_nearest_pixel_and_never_blended() -> None:
    depth = 1 + torch.rand(60, 80, generator=torch.Generator().manual_seed(0))
    mask = torch.rand(60, 80, generator=torch.Generator().manual_seed(1)) < 0.7
    moved, valid = undistort_depth(torch.where(mask, depth, 0.0), mask, K, DISTORTION)
    assert set(moved[valid].tolist()) <= set(depth[mask].tolist())
    assert not moved[~valid].any()
    compared = 0
    for v in range(60):
        for u in range(80):
            x, y = _place(u, v)
            near_tie = max(abs(x % 1 - 0.5), abs(y % 1 - 0.5)) > 0.45  # OpenCV rounds to 1/32 px
            if near_tie and min(abs(x % 1 - 0.5), abs(y % 1 - 0.5)) > 0.05:
                source = round(y), round(x)
                compared += 1
                assert bool(valid[v, u]) == bool(mask[source])
                if mask[source]:
                    assert moved[v, u] == depth[source]
    assert compared > 300


def test_images_follow_the_same_formula() -> None:
    columns = torch.arange(80).expand(60, 80).to(torch.uint8)
    image = torch.stack([columns * 3] * 3, dim=-1)
    moved = undistort_image(image, K, DISTORTION)
    for v in range(5, 55, 10):
        for u in range(10, 70, 10):
            assert abs(int(moved[v, u, 0]) - 3 * _place(u, v)[0]) < 1


def test_no_distortion_changes_nothing() -> None:
    image = torch.from_numpy(np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8))
    assert torch.equal(undistort_image(image, K, (0.0,) * 5), image)
    depth = torch.rand(60, 80)
    assert torch.equal(undistort_depth(depth, depth > 0, K, (0.0,) * 4)[0], depth)
    with pytest.raises(InputError, match="3 coefficients"):
        undistort_image(image, K, (0.0,) * 3)
