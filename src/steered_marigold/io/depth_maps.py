"""Metric depth maps. Here, and only here, 0, NaN and infinity mean "no measurement"."""

from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.files import (
    AnyPath,
    atomic_write,
    decoding,
    load_array,
    open_picture,
    require_file,
    require_pixel_count,
    require_suffix,
)

DEPTH_SUFFIXES = (".png", ".npy", ".tif", ".tiff", ".exr")
MILLIMETRE = 0.001
_LARGEST_CODE = 65535


@dataclass(frozen=True, kw_only=True)
class MissingCounts:
    """How many pixels were treated as missing, and why. A pixel is counted once.

    saturated: 65535 in a 16-bit file, which sensors write for "out of range".
    """

    zero: int
    negative: int
    non_finite: int
    saturated: int
    beyond_max_depth: int


@dataclass(frozen=True, kw_only=True)
class DepthMap:
    """What a sensor measured.

    depth: [m], z along the optical axis, 0 where valid_mask is False.
    missing: why the other pixels are not valid.
    """

    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    missing: MissingCounts


def read_depth(
    path: AnyPath, *, depth_scale: float | None = None, max_depth: float | None = None
) -> DepthMap:
    """A depth map in metres from .png (16 bits), .tiff (16 bits or float), .npy or .exr.

    depth_scale: metres per unit of the file; None means 0.001 for integers and 1 for floats.
    max_depth: farther measurements [m] count as missing. Singleton axes are squeezed.

    Raises FileFormatError for a missing, damaged or oversized file, an unknown extension, and for
    content that cannot be metric: several channels, 8 bits. InputError for a depth_scale or
    max_depth that is not positive.
    """
    for name, value in (("depth_scale", depth_scale), ("max_depth", max_depth)):
        if value is not None and not (0 < value < float("inf")):
            raise InputError(f"{name} must be a positive number, not {value}")
    file = require_file(path)
    read = _READERS[require_suffix(file, DEPTH_SUFFIXES)]
    raw = _one_metric_channel(file, read(file))
    if depth_scale is None:
        depth_scale = 1.0 if raw.dtype.kind == "f" else MILLIMETRE
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows float32 is not finite
        metres = (raw * np.float64(depth_scale)).astype(np.float32)

    is_16_bit = raw.dtype.kind == "u" and raw.dtype.itemsize == 2
    saturated = raw == _LARGEST_CODE if is_16_bit else np.zeros(raw.shape, bool)
    non_finite = ~np.isfinite(metres)
    beyond = np.isfinite(metres) & (metres > (max_depth or np.inf)) & ~saturated
    valid = (metres > 0) & ~saturated & ~non_finite & ~beyond
    return DepthMap(
        depth=torch.from_numpy(np.where(valid, metres, np.float32(0))),
        valid_mask=torch.from_numpy(valid),
        missing=MissingCounts(
            zero=int((metres == 0).sum()),
            negative=int(((metres < 0) & ~non_finite).sum()),
            non_finite=int(non_finite.sum()),
            saturated=int(saturated.sum()),
            beyond_max_depth=int(beyond.sum()),
        ),
    )


def implausible_scale(depth_map: DepthMap) -> str | None:
    """A sentence if the median depth is above 200 m or below 1 cm: a wrong scale, most likely."""
    if not depth_map.valid_mask.any():
        return None
    median = float(depth_map.depth[depth_map.valid_mask].median())
    if 0.01 <= median <= 200:
        return None
    return f"the median depth is {median:.4g} m; is the depth scale (metres per unit) right?"


def write_depth(
    path: AnyPath, depth: Float[Tensor, "height width"], *, output_scale: float = MILLIMETRE
) -> int:
    """Writes depth [m], 0 = unknown: .png uint16 in units of output_scale [m], else float32 [m].

    Values that the format cannot hold are written as 0, and their number is returned: in a .png
    what rounds to less than 1 or more than 65535 units, in the others what is not finite.

    Raises FileFormatError for an unknown extension, InputError if `path` cannot be written.
    """
    suffix = require_suffix(path, DEPTH_SUFFIXES)
    values = _to_numpy(depth)
    if suffix == ".png":
        codes = _to_codes(values, output_scale)
        fits = (codes >= 1) & (codes <= _LARGEST_CODE)
        _write_array(path, np.where(fits, codes, 0).astype(np.uint16))
    else:
        fits = np.isfinite(values)
        _write_array(path, np.where(fits, values, np.float32(0)))
    return int((~fits & (values != 0)).sum())


def write_saturating(
    path: AnyPath, values: Float[Tensor, "height width"], *, output_scale: float
) -> None:
    """Writes finite, non-negative values whose 0 is a value: relative depth, uncertainty.

    A .png holds multiples of output_scale, and its largest code stands for all larger values;
    the other formats hold the values as float32. Raises as write_depth does.
    """
    suffix = require_suffix(path, DEPTH_SUFFIXES)
    array = _to_numpy(values)
    if suffix == ".png":
        array = np.clip(_to_codes(array, output_scale), 0, _LARGEST_CODE).astype(np.uint16)
    _write_array(path, array)


def _to_numpy(values: Tensor) -> NDArray[Any]:
    return np.ascontiguousarray(values.detach().to("cpu", torch.float32).numpy())


def _to_codes(values: NDArray[Any], output_scale: float) -> NDArray[Any]:
    if not 0 < output_scale < float("inf"):
        raise InputError(f"output_scale must be a positive number, not {output_scale}")
    return np.rint(values.astype(np.float64) / output_scale)


def _one_metric_channel(path: AnyPath, array: NDArray[Any]) -> NDArray[Any]:
    """[height, width] of a type that can hold metric depth, or FileFormatError."""
    if array.ndim == 3:
        raise FileFormatError(
            f"{path}: has several channels {array.shape}: a coloured picture of depth holds no "
            "metres; export the raw depth with one channel"
        )
    if array.ndim != 2 or array.size == 0:
        raise FileFormatError(f"{path}: has shape {array.shape}; depth is [height, width]")
    if array.dtype.kind not in "fui" or array.dtype.itemsize == 1:
        raise FileFormatError(
            f"{path}: holds {array.dtype}; metric depth needs 16-bit integers or floats "
            "(the 256 levels of 8 bits are a picture of depth, not metres)"
        )
    return array


def _read_picture(path: Path) -> NDArray[Any]:
    picture = open_picture(path, ("PNG",) if path.suffix.lower() == ".png" else ("TIFF",))
    if picture.mode == "P":  # the colours are in the palette
        picture = picture.convert("RGB")
    return np.asarray(picture)


def _read_exr(path: Path) -> NDArray[Any]:
    import OpenEXR  # slow to load, and only needed here

    # the module prints its warnings on stdout, which belongs to the caller
    with decoding(path), redirect_stdout(StringIO()):
        header = OpenEXR.File(str(path), header_only=True).header()
        low, high = header["dataWindow"]
        require_pixel_count(path, int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        if len(channels) > 1 and "Z" not in channels:
            raise FileFormatError(
                f"{path}: has channels {', '.join(channels)}; depth is one channel, or one named Z"
            )
        channel = channels["Z"] if "Z" in channels else next(iter(channels.values()))
        return np.array(channel.pixels)


_READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".png": _read_picture,
    ".tif": _read_picture,
    ".tiff": _read_picture,
    ".npy": load_array,
    ".exr": _read_exr,
}


def _write_array(path: AnyPath, array: NDArray[Any]) -> None:
    """One channel, in the format that the extension names."""
    suffix = Path(path).suffix.lower()
    with atomic_write(path) as temporary:
        if suffix == ".npy":
            np.save(temporary, array)
        elif suffix == ".exr":
            import OpenEXR

            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            OpenEXR.File(header, {"Z": array}).write(str(temporary))
        else:
            Image.fromarray(array).save(temporary)
