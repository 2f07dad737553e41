"""Augmented training frames are true pictures of what they came from."""

import numpy as np
import pytest

from training.data import HEIGHT, SKY, WIDTH, Frame, augment, composite, in_colours_of, sample_of

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


@pytest.mark.parametrize("seed", range(8))
def test_what_is_pasted_hides_what_is_farther(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depths = [
        rng.integers(500, 8000, (12, 16)).astype(np.uint16).repeat(20, 0).repeat(20, 1)
        for _ in range(2)
    ]
    far, near = (
        Frame(np.full((240, 320, 3), 10 + 100 * i, np.uint8), d) for i, d in enumerate(depths)
    )
    result = composite(far, near, rng)
    pasted = result.image[..., 0] == 110
    assert (result.depth[~pasted] == far.depth[~pasted]).all()
    assert (result.depth[pasted] < 0.8 * far.depth[pasted]).all()
    assert np.isin(result.depth[pasted], near.depth).all()


def test_holes_take_the_nearest_depth_and_are_told() -> None:
    depth = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    depth[:, 160:] = 4000
    depth[:, 40:60] = 0
    sample = sample_of(Frame(np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth))
    assert sample is not None
    assert not sample["known"][0, :, 40:60].any()
    assert sample["known"].sum() == HEIGHT * (WIDTH - 20)
    np.testing.assert_allclose(sample["depth"][0, :, :160], -1)
    np.testing.assert_allclose(sample["range"], [2, 4])


def test_the_sky_is_the_far_end_and_not_of_the_range() -> None:
    depth = np.tile(np.linspace(5000, 30000, HEIGHT), (WIDTH, 1)).T.astype(np.uint16)
    without = sample_of(Frame(np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth))
    depth[-60:] = SKY
    sample = sample_of(Frame(np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth))
    assert sample is not None
    assert without is not None
    assert (sample["depth"][0, -60:] == 1).all()
    assert sample["known"].all()
    assert sample["range"][1] < without["range"][1]


def test_frames_of_which_little_is_known_are_no_samples() -> None:
    depth = np.zeros((HEIGHT, WIDTH), np.uint16)
    depth[:40] = np.linspace(1000, 3000, WIDTH).astype(np.uint16)
    assert sample_of(Frame(np.zeros((HEIGHT, WIDTH, 3), np.uint8), depth)) is None


def test_colours_of_a_photograph() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(90, 160, (HEIGHT, WIDTH, 3), np.uint8)
    warm = (rng.integers(60, 130, (480, 640, 3)) + np.array([60, 20, 0])).astype(np.uint8)
    moved = in_colours_of(warm, image)
    np.testing.assert_allclose(moved.mean(axis=(0, 1)), warm.mean(axis=(0, 1)), atol=4)
