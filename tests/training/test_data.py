"""Augmented training frames are true pictures of what they came from."""

import numpy as np
import pytest

from training.data import HEIGHT, WIDTH, Frame, augment

BORDER = 8


def ramp(border_value: int = 0) -> Frame:
    """480x640: depth [mm] rises to the right; the image shows the same in grey, but for noise."""
    depth = np.tile(np.linspace(1000, 4000, 640), (480, 1)).round().astype(np.uint16)
    depth[:BORDER] = depth[-BORDER:] = border_value
    depth[:, :BORDER] = depth[:, -BORDER:] = border_value
    image = (depth / 20).clip(0, 255).astype(np.uint8)[..., None].repeat(3, axis=2)
    return Frame(image, depth)


@pytest.mark.parametrize("seed", range(8))
def test_no_crop_reaches_into_the_border(seed: int) -> None:
    sample = augment(ramp(border_value=9999), BORDER, np.random.default_rng(seed))
    assert sample.image.shape == (HEIGHT, WIDTH, 3)
    assert sample.depth.shape == (HEIGHT, WIDTH)
    assert sample.depth.max() <= 4000


@pytest.mark.parametrize("seed", range(8))
def test_image_and_depth_stay_together(seed: int) -> None:
    sample = augment(ramp(), BORDER, np.random.default_rng(seed))
    grey = sample.image.astype(float).mean(axis=2)
    smooth = grey.reshape(HEIGHT // 8, 8, WIDTH // 8, 8).mean(axis=(1, 3))
    depth = sample.depth.reshape(HEIGHT // 8, 8, WIDTH // 8, 8).mean(axis=(1, 3))
    assert np.corrcoef(smooth.ravel(), depth.ravel())[0, 1] > 0.97


def test_crops_differ_in_size_and_angle() -> None:
    frame, rng = ramp(), np.random.default_rng(0)
    spans, angles = [], []
    for _ in range(30):
        depth = augment(frame, BORDER, rng).depth.astype(float)
        dy, dx = (np.gradient(depth, axis=axis).mean() for axis in (0, 1))
        spans.append(np.hypot(dx, dy))
        angles.append(np.degrees(np.arctan2(dy, abs(dx))))
    assert max(spans) / min(spans) > 1.4
    assert 2 < np.std(angles) < 7
