"""Messages with pictures: colour to RGB, depth to metres and back to the encoding it came in."""

import struct
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from steered_marigold.core.colours import to_8_bits
from steered_marigold.errors import FileFormatError
from steered_marigold.io.bags.messages import COMPRESSED_IMAGE, IMAGE
from steered_marigold.io.bags.rvl import decode_rvl, encode_rvl
from steered_marigold.io.depth_encodings import MILLIMETRE
from steered_marigold.io.files import decoding, require_pixel_count

# type and number of the values of a pixel
_LAYOUTS = {
    "mono8": ("u1", 1),
    "8UC1": ("u1", 1),
    "mono16": ("u2", 1),
    "16UC1": ("u2", 1),
    "32FC1": ("f4", 1),
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    "rgba8": ("u1", 4),
    "bgra8": ("u1", 4),
    "yuv422": ("u1", 2),
    "yuv422_yuy2": ("u1", 2),
    **{f"bayer_{order}8": ("u1", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{order}16": ("u2", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
}
_OPENCV = {
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "bayer_rggb": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg": cv2.COLOR_BayerGRBG2RGB,
}
DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
IMAGE_ENCODINGS = tuple(name for name in _LAYOUTS if name not in ("16UC1", "32FC1"))

# compressed_depth_image_transport: format, depthQuantA and depthQuantB before the picture
_QUANTISATION = struct.Struct("<iff")
_RVL_SIZE = struct.Struct("<II")
_INVERSE_DEPTH = 0
# 65535 says "out of range" in what sensors write
_LARGEST_CODE = 65534
_OUT_OF_RANGE = 65535
_DEEP_GREY = ("I", "I;16", "I;16B")


@dataclass(frozen=True, kw_only=True)
class MeasuredDepth:
    """depth: [m], 0 where valid_mask is False."""

    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]


def decode_image(message: Any, where: str) -> UInt8[Tensor, "height width 3"]:
    """RGB in 0..255 of an Image or a CompressedImage (JPEG, PNG) message; `where` is for errors.

    16-bit grey is stretched so that its 99.9th percentile is white, because infrared cameras use
    a small part of the 16 bits; 16-bit Bayer and colour keep their high byte. Alpha is dropped.

    Raises FileFormatError for another encoding or damaged data.
    """
    if message.__msgtype__ == COMPRESSED_IMAGE:
        picture = _open_compressed(bytes(message.data), ("JPEG", "PNG"), where)
        if picture.mode in _DEEP_GREY:
            return _stretched(np.asarray(picture))
        return torch.from_numpy(np.array(picture.convert("RGB")))
    name = message.encoding
    if name not in IMAGE_ENCODINGS:
        raise FileFormatError(
            f"{where}: the image's encoding is {name!r}; use one of {', '.join(IMAGE_ENCODINGS)}"
        )
    pixels = _pixels(message, where)
    if name == "mono16":
        return _stretched(pixels[..., 0])
    if pixels.dtype.itemsize == 2:
        pixels = (pixels >> 8).astype(np.uint8)
    code = _OPENCV.get(name.removesuffix("16").removesuffix("8"), _OPENCV.get(name))
    if code is not None:
        with decoding(where):
            pixels = cv2.cvtColor(pixels, code)
    elif name.startswith("bgr"):
        pixels = pixels[..., 2::-1]
    elif pixels.shape[2] == 1:
        pixels = pixels.repeat(3, axis=2)
    return torch.from_numpy(np.ascontiguousarray(pixels[..., :3]))


def decode_depth(message: Any, where: str, *, depth_scale: float | None = None) -> MeasuredDepth:
    """Metres and mask of an Image or compressedDepth message; `where` is for errors.

    16UC1 and mono16 hold units of `depth_scale` [m]: None is a RealSense recording's own
    `depth_units`, else millimetres; 0 and 65535 are missing. 32FC1 holds metres, and what is not
    finite or not positive is missing.

    Raises FileFormatError for another encoding or damaged data.
    """
    raw = _raw_depth(message, where)
    if raw.dtype.kind == "f":
        metres, valid = raw, np.isfinite(raw) & (raw > 0)
    else:
        metres = (raw * np.float64(depth_scale or unit_of(message))).astype(np.float32)
        valid = (raw > 0) & (raw < _OUT_OF_RANGE)
    return MeasuredDepth(
        depth=torch.from_numpy(np.where(valid, metres, np.float32(0))),
        valid_mask=torch.from_numpy(valid),
    )


def unit_of(message: Any) -> float:
    """Metres a step of a 16-bit depth message."""
    return float(getattr(message, "depth_units", 0.0)) or MILLIMETRE


@dataclass(frozen=True, kw_only=True)
class EncodedDepth:
    """A message, and how many known depths its encoding could not hold (they are missing there)."""

    message: Any
    lost: int


def encode_depth(
    depth: Float[Tensor, "height width"], like: Any, where: str, *, depth_scale: float | None = None
) -> EncodedDepth:
    """Depth [m], 0 or not finite = unknown, as a message with the header and encoding of `like`.

    depth_scale: as in `decode_depth`. Quantised 32FC1 keeps the quantisation of `like`.

    Raises FileFormatError for an encoding that `decode_depth` does not know.
    """
    metres = depth.detach().to("cpu", torch.float32).numpy()
    known = np.isfinite(metres) & (metres > 0)
    if like.__msgtype__ == IMAGE:
        if like.encoding == "32FC1":
            values = np.where(known, metres, np.float32(np.nan))
            return EncodedDepth(message=image_message(like, values), lost=0)
        codes = np.where(known, metres, 0).astype(np.float64) / (depth_scale or unit_of(like))
    else:
        encoding, quantised = _compression(like, where)[0], bytes(like.data)
        if encoding == "32FC1":
            _, a, b = _QUANTISATION.unpack_from(quantised)
            codes = a / np.where(known, metres, np.inf).astype(np.float64) + b
        else:
            codes = np.where(known, metres, 0).astype(np.float64) / (depth_scale or MILLIMETRE)
    codes = np.rint(codes)
    fits = known & (codes >= 1) & (codes <= _LARGEST_CODE)
    lost = int((known & ~fits).sum())
    written = np.where(fits, codes, 0).astype(np.uint16)
    if like.__msgtype__ == IMAGE:
        return EncodedDepth(message=image_message(like, written, like.encoding), lost=lost)
    return EncodedDepth(message=_compress(written, like, where), lost=lost)


def image_message(
    like: Any, values: NDArray[Any], encoding: str = "32FC1", kind: Any = None
) -> Any:
    """An uncompressed one-channel Image with the header of `like`; `kind` is its class.

    Codes of the same encoding get the unit that a RealSense recording has there.
    """
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    height, width = little.shape
    message = (kind or type(like))(
        header=like.header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=width * little.itemsize,
        data=little.view(np.uint8).reshape(-1),
    )
    unit = getattr(like, "depth_units", None)
    if unit is not None:
        message.depth_units = unit
    return message


def _pixels(message: Any, where: str) -> NDArray[Any]:
    """[height, width, channels] in the machine's byte order, without what pads the rows."""
    kind, channels = _LAYOUTS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width = int(message.height), int(message.width)
    require_pixel_count(where, width, height)
    row = width * channels * dtype.itemsize
    step = int(message.step) or row
    data = np.asarray(message.data, np.uint8)
    if min(height, width) < 1 or step < row or data.size < step * (height - 1) + row:
        raise FileFormatError(
            f"{where}: {data.size} bytes in rows of {step} are no {width}x{height} pixels of "
            f"{message.encoding}"
        )
    padded = np.pad(data[: step * height], (0, max(step * height - data.size, 0)))
    rows = np.ascontiguousarray(padded.reshape(height, step)[:, :row])
    return rows.view(dtype).reshape(height, width, channels).astype(dtype.newbyteorder("="))


def _raw_depth(message: Any, where: str) -> NDArray[Any]:
    """Codes (uint16) or metres (float32), [height, width]."""
    if message.__msgtype__ == IMAGE:
        if message.encoding not in DEPTH_ENCODINGS:
            raise FileFormatError(
                f"{where}: the depth's encoding is {message.encoding!r}; "
                f"use one of {', '.join(DEPTH_ENCODINGS)}"
            )
        raw: NDArray[Any] = _pixels(message, where)[..., 0]
        return raw
    encoding, codec, headed = _compression(message, where)
    data = bytes(message.data)
    codes = _uncompress(data[_QUANTISATION.size if headed else 0 :], codec, where)
    if encoding != "32FC1":
        return codes
    with decoding(where):
        _, a, b = _QUANTISATION.unpack_from(data)
    with np.errstate(divide="ignore"):
        metres = np.float32(a) / (codes.astype(np.float32) - np.float32(b))
    return np.where(codes > 0, metres, np.float32(np.nan))


def _compression(message: Any, where: str) -> tuple[str, str, bool]:
    """Encoding, codec and whether a header comes first, from a CompressedImage's `format`.

    As image_transport writes it: "16UC1; compressedDepth png", or "16UC1; png compressed" from
    the transport for colour, which keeps 16 bits too.
    """
    encoding, _, rest = (part.strip() for part in message.format.partition(";"))
    headed = "compressedDepth" in message.format or not rest
    codec = "rvl" if "rvl" in rest else "png" if headed or "png" in rest else rest
    if encoding not in DEPTH_ENCODINGS or codec not in ("png", "rvl"):
        raise FileFormatError(
            f"{where}: compressed depth of format {message.format!r} holds no metres that can be "
            "read; use compressedDepth (png or rvl) of 16UC1 or 32FC1, or the raw topic"
        )
    return encoding, codec, headed


def _uncompress(data: bytes, codec: str, where: str) -> NDArray[np.uint16]:
    """The 16-bit codes of a PNG or an RVL picture."""
    if codec == "rvl":
        with decoding(where):
            width, height = _RVL_SIZE.unpack_from(data)
            require_pixel_count(where, width, height)
            if min(width, height) < 1:
                raise ValueError("no pixels")
            return decode_rvl(data[_RVL_SIZE.size :], width * height).reshape(height, width)
    picture = _open_compressed(data, ("PNG",), where)
    if picture.mode not in ("I;16", "I"):
        raise FileFormatError(f"{where}: compressed depth must have 16 bits, not {picture.mode}")
    return np.asarray(picture).astype(np.uint16)


def _compress(codes: NDArray[np.uint16], like: Any, where: str) -> Any:
    """A CompressedImage of the format of `like`."""
    _, codec, headed = _compression(like, where)
    header = bytes(like.data[: _QUANTISATION.size]) if headed else b""
    if codec == "rvl":
        height, width = codes.shape
        picture = _RVL_SIZE.pack(width, height) + encode_rvl(codes.ravel())
    else:
        file = BytesIO()
        Image.fromarray(codes).save(file, "PNG", compress_level=1)
        picture = file.getvalue()
    return replace(like, data=np.frombuffer(header + picture, np.uint8))


def _open_compressed(data: bytes, formats: tuple[str, ...], where: str) -> Image.Image:
    """A decoded picture, checked for its size first."""
    with decoding(where):
        picture = Image.open(BytesIO(data), formats=formats)
        require_pixel_count(where, *picture.size)
        picture.load()
        return picture


def _stretched(values: NDArray[Any]) -> UInt8[Tensor, "height width 3"]:
    """Three equal channels of 16-bit grey."""
    grey, _ = to_8_bits(values)
    return torch.from_numpy(grey)[..., None].repeat(1, 1, 3)
