"""Frames from arrays of every kind, and what is refused with a name."""

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from steered_marigold.core.frame import Frame, make_frame
from steered_marigold.errors import InputError, SizeMismatchError

HEIGHT, WIDTH = 6, 8
RGB = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
DEPTH = np.random.default_rng(1).uniform(1, 4, (HEIGHT, WIDTH)).astype(np.float32)
K = np.array([[5.0, 0, 4], [0, 5, 3], [0, 0, 1]])


@pytest.mark.parametrize(
    "image",
    [
        torch.from_numpy(RGB),
        Image.fromarray(RGB),
        np.dstack([RGB, np.full((HEIGHT, WIDTH), 9, np.uint8)]),
        (RGB / 255).astype(np.float64),
        torch.from_numpy(RGB / 255).to(torch.float32),
        RGB.astype(np.uint16) * 257,
        Image.fromarray(RGB).convert("RGBA"),
        np.asfortranarray(RGB),
    ],
    ids=["tensor", "pil", "rgba", "float64", "float32", "uint16", "pil rgba", "fortran"],
)
def test_one_image_in_every_form(image: Any) -> None:
    frame = make_frame(image)
    assert np.array_equal(frame.image.numpy(), RGB)
    assert not frame.measured


@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 1)])
def test_grey_becomes_three_channels(shape: tuple[int, ...]) -> None:
    frame = make_frame(RGB[..., 0].reshape(shape))
    assert np.array_equal(frame.image.numpy(), RGB[..., :1].repeat(3, axis=2))


def test_palettes_are_looked_up() -> None:
    picture = Image.fromarray(RGB).quantize(200)
    assert np.array_equal(make_frame(picture).image.numpy(), np.asarray(picture.convert("RGB")))


def test_twelve_bits_are_stretched_and_said() -> None:
    frame = make_frame(RGB.astype(np.uint16) * 16)
    assert np.array_equal(frame.image.numpy(), RGB)
    assert [notice.kind for notice in frame.notices] == ["colour_stretched"]


@pytest.mark.parametrize("kind", ["float16", "float32", "float64", "uint16", "int64"])
def test_depth_of_every_real_type(kind: str) -> None:
    depth = np.rint(DEPTH).astype(kind)
    depth[0, 0] = 0
    frame = make_frame(RGB, depth, K=K, id="a", stamp=3.5)
    assert np.array_equal(frame.sparse_depth.numpy(), depth.astype(np.float32))
    assert np.array_equal(frame.valid_mask.numpy(), depth > 0)
    assert frame.K is not None
    assert (frame.K.dtype, frame.id, frame.stamp) == (torch.float32, "a", 3.5)


@given(st.floats(width=32))
def test_without_a_mask_what_is_finite_and_positive_is_measured(value: float) -> None:
    frame = make_frame(RGB, np.full((HEIGHT, WIDTH), value, np.float32))
    assert frame.measured == (np.isfinite(value) and value > 0)
    assert bool(torch.isfinite(frame.sparse_depth).all())


def test_the_mask_is_the_truth() -> None:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[2] = True
    for given_mask in (mask, mask.astype(np.uint8), torch.from_numpy(mask)):
        frame = make_frame(RGB, np.where(mask, DEPTH, np.nan), given_mask)
        assert np.array_equal(frame.valid_mask.numpy(), mask)
        assert np.array_equal(frame.sparse_depth.numpy(), np.where(mask, DEPTH, 0))


def test_what_is_kept_and_cropped() -> None:
    frame = make_frame(RGB, DEPTH, K=K, confidence=np.ones_like(DEPTH))
    kept = frame.keep(torch.from_numpy(DEPTH > 2))
    assert np.array_equal(kept.sparse_depth.numpy(), np.where(DEPTH > 2, DEPTH, 0))
    part = frame.crop(slice(1, 5), slice(2, 8))
    assert part.size == (4, 6)
    assert part.K is not None
    assert part.K[:2, 2].tolist() == [2.0, 2.0]


def _raises(match: str, error: type[Exception] = InputError, **arguments: Any) -> None:
    with pytest.raises(error, match=match):
        make_frame(**{"image": RGB, "sparse_depth": DEPTH, **arguments})


def test_what_cannot_be_a_frame_is_named() -> None:
    _raises("channels first", image=RGB.transpose(2, 0, 1))
    _raises("`image` has floats", image=RGB.astype(np.float32))
    _raises("`image` has floats", image=np.full(RGB.shape, np.nan))
    _raises("`image` must be uint8", image=RGB.astype(np.int64))
    _raises("`image` must be an array of numbers", image="image.png")
    _raises(r"`sparse_depth` must be \[height, width\]", sparse_depth=DEPTH[None])
    _raises("`sparse_depth` is", SizeMismatchError, sparse_depth=DEPTH[1:])
    _raises("`valid_mask` is", SizeMismatchError, valid_mask=np.ones((2, 2), bool))
    _raises("`valid_mask` must be boolean", valid_mask=np.full(DEPTH.shape, 255))
    _raises("finite and positive", sparse_depth=-DEPTH, valid_mask=np.ones(DEPTH.shape, bool))
    _raises("`confidence` must lie", confidence=DEPTH)
    _raises("`confidence` is", SizeMismatchError, confidence=np.ones((2, 2)))
    _raises("`K` must be a finite 3x3", K=np.eye(2))
    _raises("`K` must be", K=np.diag([0.0, 1, 1]))
    _raises("`K` must be", K=np.full((3, 3), np.nan))


def test_a_wrong_unit_is_doubted() -> None:
    frame: Frame = make_frame(RGB, 1000 * DEPTH)
    assert [notice.kind for notice in frame.notices] == ["implausible_scale"]
    assert "`depth_scale`" in frame.notices[0].text
