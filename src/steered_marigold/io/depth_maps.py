"""Metric depth maps. Here, and only here, 0, NaN and infinity mean "no measurement"."""

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from steered_marigold.core.notices import Notices
from steered_marigold.core.plausibility import FARTHEST, NEAREST
from steered_marigold.errors import InputError
from steered_marigold.io.code_doubts import code_doubts
from steered_marigold.io.depth_encodings import (
    MILLIMETRE,
    require_encoding,
    to_metres,
    to_numbers,
)
from steered_marigold.io.depth_files import load_depth_file
from steered_marigold.io.files import AnyPath, atomic_write, require_suffix

WRITABLE_DEPTH_SUFFIXES = (".png", ".npy", ".tif", ".tiff", ".exr")
_LARGEST_CODE = 65535


@dataclass(frozen=True, kw_only=True)
class DepthMap:
    """What a sensor measured.

    depth: [m], z along the optical axis, 0 where valid_mask is False.
    missing: how many of the other pixels are not valid for which reason, each counted once: zero,
        negative, non_finite, saturated (65535 in a 16-bit file, which sensors write for "out of
        range"), beyond_limits (below 1 mm or above 100 km), beyond_max_depth.
    notes: what was read otherwise than written, or is doubtful.
    """

    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    missing: Mapping[str, int]
    notes: Notices = ()


def read_depth(
    path: AnyPath,
    *,
    depth_scale: float | None = None,
    max_depth: float | None = None,
    depth_encoding: str = "z",
    K: Float[Tensor, "3 3"] | None = None,
    baseline: float | None = None,
) -> DepthMap:
    """A depth map in metres from a file of DEPTH_SUFFIXES, or an array of an archive, "a.h5:name".

    depth_scale: metres per unit of the file; None means 0.001 for integers and 1 for floats. For
        disparity pixels per unit, for inverse depth 1/m per unit, and needed for integers.
    max_depth: farther measurements [m] count as missing. Singleton axes are squeezed.
    depth_encoding: what the numbers mean, see depth_encodings. K: of the depth map [px];
    baseline: distance of the two cameras [m]; for encodings that need them.

    Raises FileFormatError for a missing, damaged or oversized file, an unknown extension, and for
    content that cannot be metric: several channels, 8 bits. InputError for an argument that is
    not positive, missing or without use. MissingExtraError for HDF5 and HEIC without their extra.
    """
    for name, value in (
        ("depth_scale", depth_scale),
        ("max_depth", max_depth),
        ("baseline", baseline),
    ):
        if value is not None and not (0 < value < float("inf")):
            raise InputError(f"`{name}` must be a positive number, not {value}")
    require_encoding(depth_encoding, depth_scale=depth_scale, K=K, baseline=baseline)
    stored = load_depth_file(path)
    numbers, notes = to_numbers(Path(path), stored, depth_encoding)
    metres = to_metres(
        Path(path), numbers, depth_encoding, depth_scale=depth_scale, K=K, baseline=baseline
    )
    reasons = _reasons_for_missing(numbers, metres, max_depth or np.inf)
    valid = ~np.any(list(reasons.values()), axis=0)
    doubts = code_doubts(numbers) if depth_encoding in ("z", "tum", "kitti") else ()
    return DepthMap(
        depth=torch.from_numpy(np.where(valid, metres, 0).astype(np.float32)),
        valid_mask=torch.from_numpy(valid),
        missing={reason: int(mask.sum()) for reason, mask in reasons.items()},
        notes=notes + doubts,
    )


def _reasons_for_missing(
    numbers: NDArray[Any], metres: NDArray[np.float64], max_depth: float
) -> dict[str, NDArray[np.bool_]]:
    """For each reason the pixels [height, width] that are missing for it, and for no other."""
    is_16_bit = numbers.dtype.kind == "u" and numbers.dtype.itemsize == 2
    saturated = numbers == _LARGEST_CODE if is_16_bit else np.zeros(numbers.shape, bool)
    finite = np.isfinite(metres) & ~saturated
    limited = finite & (metres > 0) & ((metres < NEAREST) | (metres > FARTHEST))
    return {
        "zero": finite & (metres == 0),
        "negative": finite & (metres < 0),
        "non_finite": ~np.isfinite(metres) & ~saturated,
        "saturated": saturated,
        "beyond_limits": limited,
        "beyond_max_depth": finite & (metres > max_depth) & ~limited,
    }


def write_depth(
    path: AnyPath, depth: Float[Tensor, "height width"], *, output_scale: float = MILLIMETRE
) -> int:
    """Writes depth [m], 0 = unknown: .png uint16 in units of output_scale [m], else float32 [m].

    Values that the format cannot hold are written as 0, and their number is returned: in a .png
    what rounds to less than 1 or more than 65535 units, in the others what is not finite.

    Raises FileFormatError for an unknown extension, InputError if `path` cannot be written or if
    no depth at all fits.
    """
    suffix = require_suffix(path, WRITABLE_DEPTH_SUFFIXES)
    values = _to_numpy(depth)
    if suffix == ".png":
        codes = _to_codes(values, output_scale)
        fits = (codes >= 1) & (codes <= _LARGEST_CODE)
        if (values > 0).any() and not fits.any():
            raise InputError(
                f"{path}: no depth fits 16 bits in units of {output_scale} m (the largest is "
                f"{np.nanmax(values):.4g} m); was `depth_scale` right? `output_scale` is in metres "
                "per unit, as 0.001"
            )
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
    suffix = require_suffix(path, WRITABLE_DEPTH_SUFFIXES)
    array = _to_numpy(values)
    if suffix == ".png":
        array = np.clip(_to_codes(array, output_scale), 0, _LARGEST_CODE).astype(np.uint16)
    _write_array(path, array)


def _to_numpy(values: Tensor) -> NDArray[Any]:
    return np.ascontiguousarray(values.detach().to("cpu", torch.float32).numpy())


def _to_codes(values: NDArray[Any], output_scale: float) -> NDArray[Any]:
    if not 0 < output_scale < float("inf"):
        raise InputError(f"`output_scale` must be a positive number, not {output_scale}")
    return np.rint(values.astype(np.float64) / output_scale)


def _write_array(path: AnyPath, array: NDArray[Any]) -> None:
    """One channel, in the format that the extension names."""
    suffix = Path(path).suffix.lower()
    with atomic_write(path) as temporary:
        if suffix == ".exr":
            _write_exr(temporary, array)
            return
        # NumPy and Pillow do not notice every full disk; Python's own files do
        content = BytesIO()
        if suffix == ".npy":
            np.save(content, array)
        else:
            Image.fromarray(array).save(content, "PNG" if suffix == ".png" else "TIFF")
        temporary.write_bytes(content.getbuffer())


def _write_exr(path: Path, array: NDArray[Any]) -> None:
    """One channel, Z. Raises OSError if the system refuses, as the other writers do."""
    import OpenEXR  # slow to load, and only needed here

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        OpenEXR.File(header, {"Z": array}).write(str(path))
        # the last bytes are written as the file is closed, where a full disk goes untold
        written = OpenEXR.File(str(path)).channels()["Z"].pixels
        whole = np.array_equal(written, array, equal_nan=True)
    except (RuntimeError, KeyError):
        whole = False
    if not whole:
        path.write_bytes(array.tobytes())  # Python tells the system's reason
        raise OSError(errno.EIO, os.strerror(errno.EIO))
