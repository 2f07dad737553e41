"""Every encoding, decoded against pixels laid out by hand, and depth back into its encoding."""

import struct
from io import BytesIO
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError
from steered_marigold.io.bags.image_messages import (
    decode_depth,
    decode_image,
    encode_depth,
)
from steered_marigold.io.bags.rvl import encode_rvl
from tests.io.bags.building import Builder, colour, depth_mm

ros = pytest.mark.parametrize("builder", [Builder(1), Builder(2)], ids=["ros1", "ros2"])
RGB = colour(0)
ALPHA = np.full((*RGB.shape[:2], 1), 77, np.uint8)
GREY = RGB[..., 0]


def _stretched(grey: NDArray[Any]) -> NDArray[np.uint8]:
    white = np.percentile(grey.astype(np.float32), 99.9)
    scaled: NDArray[np.uint8] = np.rint(np.clip(grey / np.float32(white), 0, 1) * 255).astype(
        np.uint8
    )
    return scaled


def _three(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.stack([grey] * 3, axis=2)


DEEP = (GREY.astype(np.uint16) * 37) + 5
COLOURS: dict[str, tuple[NDArray[Any], NDArray[np.uint8]]] = {
    "rgb8": (RGB, RGB),
    "bgr8": (RGB[..., ::-1], RGB),
    "rgba8": (np.concatenate([RGB, ALPHA], 2), RGB),
    "bgra8": (np.concatenate([RGB[..., ::-1], ALPHA], 2), RGB),
    "mono8": (GREY, _three(GREY)),
    "8UC1": (GREY, _three(GREY)),
    "mono16": (DEEP, _three(_stretched(DEEP))),
}


@pytest.mark.parametrize("pad", [0, 5, 6])
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", COLOURS)
@ros
def test_colour_encodings(builder: Builder, encoding: str, big_endian: bool, pad: int) -> None:
    """Rows may be padded, and 16 bits come in either order."""
    pixels, expected = COLOURS[encoding]
    message = builder.image(np.ascontiguousarray(pixels), encoding, pad=pad, big_endian=big_endian)
    assert torch.equal(decode_image(message, "here"), torch.from_numpy(expected.copy()))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_encodings(order: str, bits: int) -> None:
    """An image of one colour, sampled through the mosaic, comes out in that colour."""
    rgb = np.array([200, 120, 40])
    tile = np.array(["rgb".index(letter) for letter in order]).reshape(2, 2)
    mosaic = np.tile(rgb[tile], (4, 5))
    pixels = mosaic.astype(np.uint8) if bits == 8 else (mosaic * 256 + 99).astype(np.uint16)
    image = decode_image(Builder(2).image(pixels, f"bayer_{order}{bits}"), "here")
    assert (image == torch.from_numpy(rgb)).all()


@pytest.mark.parametrize(("encoding", "code"), [("yuv422", "UYVY"), ("yuv422_yuy2", "YUYV")])
def test_yuv_encodings(encoding: str, code: str) -> None:
    """Grey levels, whose chroma is 128, are kept; BT.601 stretches 16..235 to 0..255."""
    luma = np.arange(16, 236, dtype=np.uint8)[:216].reshape(6, 36)
    chroma = np.full_like(luma, 128)
    pixels = np.stack([chroma, luma] if code == "UYVY" else [luma, chroma], axis=2)
    expected = np.clip((luma.astype(float) - 16) * 255 / 219, 0, 255)
    image = decode_image(Builder(2).image(pixels, encoding), "here").numpy()
    assert np.abs(image - expected[..., None]).max() <= 1


def _file(pixels: NDArray[Any], kind: str) -> bytes:
    file = BytesIO()
    Image.fromarray(pixels).save(file, kind)
    return file.getvalue()


@ros
def test_compressed_images(builder: Builder) -> None:
    png = builder.compressed(_file(RGB, "PNG"), "bgr8; png compressed bgr8")
    assert torch.equal(decode_image(png, "here"), torch.from_numpy(RGB))
    smooth = cv2.resize(RGB, (64, 48))
    jpeg = builder.compressed(_file(smooth, "JPEG"), "rgb8; jpeg compressed bgr8")
    assert np.abs(decode_image(jpeg, "here").numpy().astype(int) - smooth).mean() < 5
    deep = builder.compressed(_file(DEEP, "PNG"), "mono16; png compressed ")
    assert torch.equal(decode_image(deep, "here"), torch.from_numpy(_three(_stretched(DEEP))))


MILLIMETRES = depth_mm(3)
METRES = (MILLIMETRES * 0.001).astype(np.float32)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@ros
def test_depth_in_millimetres(builder: Builder, encoding: str, big_endian: bool) -> None:
    pixels = MILLIMETRES.copy()
    pixels[0, :2] = 0, 65535
    message = builder.image(pixels, encoding, pad=4, big_endian=big_endian)
    depth = decode_depth(message, "here")
    assert depth.valid_mask[0, :2].tolist() == [False, False]
    known = torch.from_numpy(MILLIMETRES > 0)[1:]
    assert torch.equal(depth.valid_mask[1:], known)
    assert torch.equal(depth.depth[1:], torch.from_numpy(METRES)[1:])
    scaled = decode_depth(message, "here", depth_scale=0.0001).depth[1:]
    assert torch.allclose(scaled, torch.from_numpy(METRES)[1:] / 10)


@pytest.mark.parametrize("big_endian", [False, True])
def test_depth_in_metres(big_endian: bool) -> None:
    pixels = np.array([[1.5, np.nan, np.inf], [0.0, -1.0, 7.25]], np.float32)
    depth = decode_depth(Builder(2).image(pixels, "32FC1", big_endian=big_endian), "here")
    assert depth.depth.tolist() == [[1.5, 0, 0], [0, 0, 7.25]]
    assert depth.valid_mask.tolist() == [[True, False, False], [False, False, True]]


def _quantised(metres: NDArray[np.float32], depth_max: float, quantum: float) -> tuple[Any, bytes]:
    """Inverse depth as compressed_depth_image_transport codes it, and the header before it."""
    a = np.float32(quantum) * (np.float32(quantum) + 1)
    b = 1 - a / np.float32(depth_max)
    with np.errstate(divide="ignore"):
        codes = np.where((metres > 0) & (metres < depth_max), a / metres + b, 0)
    return codes.astype(np.uint16), struct.pack("<iff", 0, a, b)


def _compressed_depth(builder: Builder, codes: NDArray[np.uint16], form: str, header: bytes) -> Any:
    if "rvl" in form:
        height, width = codes.shape
        data = struct.pack("<II", width, height) + encode_rvl(codes.ravel())
    else:
        data = _file(codes, "PNG")
    return builder.compressed(header + data, form)


@pytest.mark.parametrize("codec", ["", " png", " rvl"])
@ros
def test_compressed_depth_in_millimetres(builder: Builder, codec: str) -> None:
    form = f"16UC1; compressedDepth{codec}"
    message = _compressed_depth(builder, MILLIMETRES, form, bytes(12))
    depth = decode_depth(message, "here")
    assert torch.equal(depth.depth, torch.from_numpy(METRES))
    assert torch.equal(depth.valid_mask, torch.from_numpy(MILLIMETRES > 0))


@pytest.mark.parametrize("codec", ["png", "rvl"])
def test_compressed_depth_in_metres(codec: str) -> None:
    """Quantised inverse depth is exact to half a step: about z^2 / (quantum (quantum + 1))."""
    codes, header = _quantised(METRES, 10.0, 100.0)
    message = _compressed_depth(Builder(2), codes, f"32FC1; compressedDepth {codec}", header)
    depth = decode_depth(message, "here")
    assert torch.equal(depth.valid_mask, torch.from_numpy(METRES > 0))
    error = np.abs(depth.depth.numpy() - METRES)
    assert (error <= METRES**2 / (100 * 101) * 1.01).all()


def test_depth_in_a_plain_png() -> None:
    """What the transport for colour makes of 16-bit depth."""
    message = Builder(1).compressed(_file(MILLIMETRES, "PNG"), "16UC1; png compressed ")
    assert torch.equal(decode_depth(message, "here").depth, torch.from_numpy(METRES))


def _like(builder: Builder, form: str) -> Any:
    """A depth message of each form."""
    if form in ("16UC1", "mono16", "32FC1"):
        pixels = METRES if form == "32FC1" else MILLIMETRES
        return builder.image(pixels, form, frame_id="optical", pad=8, big_endian=True)
    codes, header = _quantised(METRES, 10.0, 100.0)
    if form.startswith("16UC1"):
        codes, header = MILLIMETRES, bytes(12) if "compressedDepth" in form else b""
    return _compressed_depth(builder, codes, form, header)


FORMS = [
    "16UC1",
    "mono16",
    "32FC1",
    "16UC1; compressedDepth",
    "16UC1; compressedDepth png",
    "16UC1; compressedDepth rvl",
    "16UC1; png compressed ",
    "32FC1; compressedDepth png",
    "32FC1; compressedDepth rvl",
]


@pytest.mark.parametrize("form", FORMS)
@ros
def test_depth_goes_back_into_its_encoding(builder: Builder, form: str) -> None:
    """What a message holds, encoded like it, is decoded as the same depth."""
    like = _like(builder, form)
    before = decode_depth(like, "here")
    encoded = encode_depth(before.depth, like, "here")
    assert encoded.lost == 0
    assert type(encoded.message) is type(like)
    assert encoded.message.header == like.header
    for field in ("encoding", "format"):
        assert getattr(encoded.message, field, None) == getattr(like, field, None)
    after = decode_depth(encoded.message, "here")
    assert torch.equal(after.valid_mask, before.valid_mask)
    assert torch.equal(after.depth, before.depth)


@given(st.lists(st.floats(0.001, 65.5), min_size=12, max_size=12))
def test_dense_depth_is_kept_to_half_a_millimetre(values: list[float]) -> None:
    depth = torch.tensor(values).reshape(3, 4)
    encoded = encode_depth(depth, _like(Builder(2), "16UC1"), "here")
    after = decode_depth(encoded.message, "here")
    assert encoded.lost == 0
    assert after.valid_mask.all()
    assert (after.depth - depth).abs().max() < 0.000501 + 1e-6 * depth.max()


def test_depths_that_do_not_fit_are_missing_and_counted() -> None:
    depth = torch.tensor([[0.0, 1.0, float("nan")], [70.0, 0.0001, 2.0]])
    encoded = encode_depth(depth, _like(Builder(2), "16UC1"), "here")
    after = decode_depth(encoded.message, "here")
    assert encoded.lost == 2
    assert after.valid_mask.tolist() == [[False, True, False], [False, False, True]]
    far = encode_depth(torch.full((2, 2), 50.0), _like(Builder(2), FORMS[-1]), "here")
    assert far.lost == 4


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (Builder(2).image(RGB, "8UC3"), "encoding is '8UC3'"),
        (Builder(2).image(METRES, "32FC1"), "encoding is '32FC1'"),
        (Builder(2).compressed(b"nothing", "jpeg"), "damaged"),
        (Builder(2).compressed(_file(RGB, "PNG")[:60], "png"), "damaged"),
    ],
)
def test_images_that_cannot_be_read_are_refused(message: Any, reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason) as raised:
        decode_image(message, "the bag: /topic at 3 s")
    assert str(raised.value).startswith("the bag: /topic at 3 s: ")


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (Builder(2).image(GREY, "mono8"), "encoding is 'mono8'"),
        (Builder(2).compressed(_file(RGB, "JPEG"), "16UC1; jpeg compressed "), "no metres"),
        (Builder(2).compressed(bytes(20), "16UC1; compressedDepth zstd"), "damaged|no metres"),
        (Builder(2).compressed(bytes(5), "32FC1; compressedDepth png"), "damaged"),
        (Builder(2).compressed(bytes(12) + bytes(8), "16UC1; compressedDepth rvl"), "damaged"),
        (
            Builder(2).compressed(bytes(12) + _file(GREY, "PNG"), "16UC1; compressedDepth png"),
            "16 bits",
        ),
    ],
)
def test_depth_that_cannot_be_read_is_refused(message: Any, reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason):
        decode_depth(message, "here")


def test_data_too_short_for_the_picture_is_refused() -> None:
    message = Builder(2).image(RGB, "rgb8")
    message.data = message.data[:-1]
    with pytest.raises(FileFormatError, match="no 8x6 pixels"):
        decode_image(message, "here")


def test_the_last_row_may_lack_its_padding() -> None:
    message = Builder(2).image(RGB, "rgb8", pad=7)
    message.data = message.data[:-7]
    assert torch.equal(decode_image(message, "here"), torch.from_numpy(RGB))
