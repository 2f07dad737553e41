"""From the numbers of a depth file to metres along the optical axis.

| encoding | what a number v of the file means | needs |
|---|---|---|
| z | depth, v * depth_scale | |
| ray | length of the line of sight, v * depth_scale | K |
| disparity | shift of v * depth_scale pixels: z = fx * baseline / shift | K, baseline |
| inverse | 1 / z in 1/m, v * depth_scale | |
| sunrgbd | millimetres, the 16 bits rotated left by 3 (SUN RGB-D toolbox) | |
| tum | v / 5000 (TUM RGB-D) | |
| kitti | v / 256 (KITTI depth) | |
| carla | (R + 256 G + 65536 B) / (2^24 - 1) * 1000 m (CARLA's camera) | |
| rgb24 | (65536 R + 256 G + B) * depth_scale | |
| tartanair | the bytes B, G, R, A are a little-endian float32 in metres (TartanAir) | |
"""

from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.geometry import ray_lengths
from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import FileFormatError, InputError

DepthEncoding = Literal[
    "z", "ray", "disparity", "inverse", "sunrgbd", "tum", "kitti", "carla", "rgb24", "tartanair"
]
DEPTH_ENCODINGS: tuple[str, ...] = get_args(DepthEncoding)
MILLIMETRE = 0.001
_FIXED_SCALES = {"sunrgbd": MILLIMETRE, "tum": 1 / 5000, "kitti": 1 / 256}
_CARLA_SCALE = 1000 / (256**3 - 1)
_BYTES = ("carla", "rgb24", "tartanair")  # each pixel's number lies in several channels of 8 bits


def require_encoding(
    encoding: str,
    *,
    depth_scale: float | None,
    K: Float[Tensor, "3 3"] | None,
    baseline: float | None,
) -> None:
    """InputError unless the encoding is known and has what it needs, and nothing it ignores."""
    if encoding not in DEPTH_ENCODINGS:
        raise InputError(
            f"`depth_encoding` is one of {', '.join(DEPTH_ENCODINGS)}, not {encoding!r}"
        )
    if depth_scale is not None and (
        encoding in _FIXED_SCALES or encoding in ("carla", "tartanair")
    ):
        raise InputError(f"`depth_encoding` {encoding} has its own unit; leave out `depth_scale`")
    if K is None and encoding in ("ray", "disparity"):
        raise InputError(f"`depth_encoding` {encoding} needs the camera; give its intrinsics `K`")
    if (baseline is not None) != (encoding == "disparity"):
        raise InputError(
            "`baseline` [m], the distance of the two cameras, goes with `depth_encoding` disparity "
            "and with no other"
        )


def to_numbers(path: Path, array: NDArray[Any], encoding: str) -> tuple[NDArray[Any], Notices]:
    """One number a pixel, [height, width], of a type that can hold it, or FileFormatError.

    Three equal channels are one; a fourth, the opacity, is left out.
    """
    if encoding in _BYTES:
        return _from_bytes(path, array, encoding), ()
    notes: Notices = ()
    can_hold_depth = array.dtype.itemsize > 1 or encoding == "disparity"
    if array.ndim == 3 and array.shape[2] in (2, 3, 4) and can_hold_depth:
        channels = array[..., :1] if array.shape[2] == 2 else array[..., :3]
        if array.shape[2] > 2 and np.array_equal(
            channels, np.broadcast_to(channels[..., :1], channels.shape), equal_nan=_is_float(array)
        ):
            text = "The depth map has equal channels; one was read."
            array, notes = channels[..., 0], (Notice("equal_channels", text),)
    if array.ndim == 3:
        raise FileFormatError(
            f"{path}: has several channels {array.shape}: a coloured picture of depth holds no "
            "metres; export the raw depth with one channel, or, if its colours are the bytes of a "
            "number, name their `depth_encoding` (carla, rgb24, tartanair)"
        )
    if array.ndim != 2 or array.size == 0:
        raise FileFormatError(f"{path}: has shape {array.shape}; depth is [height, width]")
    if array.dtype.kind not in "fui" or not can_hold_depth:
        raise FileFormatError(
            f"{path}: holds {array.dtype}; metric depth needs 16-bit integers or floats "
            "(the 256 levels of 8 bits are a picture of depth, not metres)"
        )
    if encoding in _FIXED_SCALES and array.dtype.kind == "f":
        raise FileFormatError(f"{path}: holds floats; `depth_encoding` {encoding} is of integers")
    if encoding == "sunrgbd":
        if array.dtype != np.uint16:
            raise FileFormatError(f"{path}: `depth_encoding` sunrgbd is of 16 bits")
        array = array >> 3 | array << 13
    return array, notes


def to_metres(
    path: Path,
    numbers: NDArray[Any],
    encoding: str,
    *,
    depth_scale: float | None,
    K: Float[Tensor, "3 3"] | None,
    baseline: float | None,
) -> NDArray[np.float64]:
    """Depth [m] along the optical axis; what stands for none stays 0 or not finite.

    Raises InputError if disparities or inverse depths are integers and `depth_scale` is None.
    """
    is_float = numbers.dtype.kind == "f"
    if depth_scale is None and not is_float and encoding in ("disparity", "inverse"):
        unit = "pixels" if encoding == "disparity" else "1/m"
        raise InputError(
            f"{path}: holds integers: `depth_scale` must tell their unit in {unit}, such as "
            "1/256 as KITTI writes disparity, or 1/16 as OpenCV does"
        )
    default = 1.0 if is_float or encoding == "carla" else MILLIMETRE
    scale = _FIXED_SCALES.get(encoding) or depth_scale or default
    with np.errstate(over="ignore", invalid="ignore"):
        values: NDArray[np.float64] = numbers * np.float64(scale)
        if encoding in ("disparity", "inverse"):
            factor = 1.0
            if encoding == "disparity" and K is not None and baseline is not None:
                factor = float(K[0, 0]) * baseline
            # no shift, and one without end, both mean that nothing was matched
            measured = np.isfinite(values) & (values != 0)
            return np.divide(factor, values, out=np.zeros_like(values), where=measured)
        if encoding == "ray" and K is not None:
            height, width = values.shape
            values /= ray_lengths(K.to(torch.float64), (height, width)).numpy()
    return values


def _from_bytes(path: Path, array: NDArray[Any], encoding: str) -> NDArray[Any]:
    channels = 4 if encoding == "tartanair" else 3
    if array.ndim != 3 or array.dtype != np.uint8 or array.shape[2] < channels:
        raise FileFormatError(
            f"{path}: `depth_encoding` {encoding} needs {channels} channels of 8 bits, not "
            f"{array.dtype} {list(array.shape)}"
        )
    if encoding == "tartanair":
        blue_first = np.ascontiguousarray(array[..., [2, 1, 0, 3]])
        return blue_first.view("<f4")[..., 0]
    red, green, blue = (array[..., index].astype(np.int64) for index in range(3))
    if encoding == "carla":
        return (red + 256 * green + 65536 * blue) * _CARLA_SCALE
    return 65536 * red + 256 * green + blue


def _is_float(array: NDArray[Any]) -> bool:
    return array.dtype.kind == "f"
