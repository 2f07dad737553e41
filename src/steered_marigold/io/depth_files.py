"""The numbers of a depth file, as they are stored: one reader a format."""

import csv
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steered_marigold.errors import FileFormatError, InputError, MissingExtraError
from steered_marigold.io.files import (
    AnyPath,
    decoding,
    load_array,
    require_file,
    require_pixel_count,
    require_suffix,
    split_name,
    squeezed,
)
from steered_marigold.io.heif import HEIF_SUFFIXES, read_heif_depth
from steered_marigold.io.netpbm import read_netpbm, read_pfm
from steered_marigold.io.pixels import read_pixels

_ARCHIVES = (".npz", ".h5", ".hdf5")
_METADATA = "metadata.csv"  # beside a frame that the RealSense viewer saved


def load_depth_file(path: AnyPath) -> NDArray[Any]:
    """The file's array; "file.npz:name" and "file.h5:name" choose one of an archive.

    Raises FileFormatError for a missing, damaged or oversized file or an unknown extension;
    MissingExtraError where reading needs an extra that is not installed.
    """
    file, member = split_member(path)
    require_file(file)
    if file.suffix.lower() in (".jpg", ".jpeg"):
        raise FileFormatError(f"{file}: a JPEG is a picture of depth, with no metres in it")
    suffix = require_suffix(file, DEPTH_SUFFIXES)
    if suffix in _ARCHIVES:
        return _read_archive(file, member)
    return _READERS[suffix](file)


def split_member(path: AnyPath) -> tuple[Path, str | None]:
    """("file.h5", "dataset") from "file.h5:dataset"; (path, None) if no array is named."""
    text = str(path)
    for suffix in _ARCHIVES:
        file, found, member = text.partition(f"{suffix}:")
        if found and member:
            return Path(file + suffix), member
    return Path(path), None


def is_depth_name(name: AnyPath) -> bool:
    """Whether a file of this name may hold depth: a known extension, and no metadata."""
    text = str(name).lower()
    return split_name(text)[1] in DEPTH_SUFFIXES and not text.endswith(_METADATA)


def require_other_file(image: AnyPath, depth: AnyPath) -> None:
    """InputError if `image` and `depth` are the same file or folder; HEIC files may hold both."""
    other = split_member(depth)[0]
    if not Path(image).exists() or not other.exists() or not other.samefile(image):
        return
    if other.suffix.lower() not in HEIF_SUFFIXES:
        raise InputError(
            f"{image}: is given as the image and as its depth map; give the image that belongs to "
            "the depth map"
        )


def _read_archive(path: Path, member: str | None) -> NDArray[Any]:
    """The named array, or the only one, of an .npz or HDF5 file."""
    if path.suffix.lower() == ".npz":
        # NumPy leaves a damaged file open that it has opened itself
        with (
            decoding(path),
            path.open("rb") as file,
            np.load(file, allow_pickle=False) as arrays,
        ):
            array = np.asarray(arrays[_chosen(path, list(arrays.files), member)])
            require_pixel_count(path, array.size, 1)
            return squeezed(array)
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError("eval", "h5py") from error
    names: list[str] = []
    with decoding(path), h5py.File(path) as file:
        file.visititems(
            lambda name, node: names.append(name) if isinstance(node, h5py.Dataset) else None
        )
        data = file[_chosen(path, names, member and member.strip("/"))]
        require_pixel_count(path, data.size, 1)
        return squeezed(np.asarray(data))


def _chosen(path: Path, names: list[str], member: str | None) -> str:
    if member is None and len(names) == 1:
        return names[0]
    if member is None or member not in names:
        found = ", ".join(sorted(names)[:20]) or "nothing"
        wanted = "several arrays" if member is None and names else f"no array {member}"
        raise FileFormatError(f"{path}: has {wanted}; name one as {path.name}:NAME, of {found}")
    return member


def _read_csv(path: Path) -> NDArray[Any]:
    """A matrix of numbers, row by row: integers if no number has a point, else floats."""
    with decoding(path), path.open(newline="", encoding="utf-8-sig") as file:
        rows = [[cell for cell in row if cell.strip()] for row in csv.reader(file)]
        rows = [row for row in rows if row]
        if not rows or len({len(row) for row in rows}) > 1:
            raise FileFormatError(f"{path}: its rows have not all the same number of columns")
        require_pixel_count(path, len(rows), len(rows[0]))
        whole = all(cell.strip().isdigit() for row in rows for cell in row)
        return np.array(rows).astype(np.int64 if whole else np.float64)


def _read_raw(path: Path) -> NDArray[Any]:
    """16-bit depth of the RealSense viewer; the size is in the metadata file beside it."""
    candidates = [path.with_name(f"{path.stem}{mark}{_METADATA}") for mark in "_-"]
    metadata = next((file for file in candidates if file.is_file()), None)
    if metadata is None:
        raise FileFormatError(
            f"{path}: the size of raw depth is in its metadata; put {candidates[0].name} beside it"
        )
    with decoding(metadata):
        lines = metadata.read_text(encoding="utf-8-sig").splitlines()
        fields = dict(line.split(",", 1) for line in lines if "," in line)
        width, height = int(fields["Resolution x"]), int(fields["Resolution y"])
    kind = fields.get("Format", "Z16").strip().upper()
    if kind != "Z16":
        raise FileFormatError(f"{path}: holds {kind}, as {metadata.name} says; depth is Z16")
    require_pixel_count(path, width, height)
    if path.stat().st_size != 2 * width * height:
        raise FileFormatError(
            f"{path}: holds {path.stat().st_size} bytes, but {metadata.name} says {width}x{height} "
            "of 16 bits"
        )
    return np.fromfile(path, "<u2").astype(np.uint16).reshape(height, width)


def _read_exr(path: Path) -> NDArray[Any]:
    """One channel, or the one named Z; channels R, G, B as [height, width, 3]."""
    import OpenEXR  # slow to load, and only needed here

    # the module prints its warnings on stdout, which belongs to the caller
    with decoding(path), redirect_stdout(StringIO()):
        header = OpenEXR.File(str(path), header_only=True).header()
        low, high = header["dataWindow"]
        require_pixel_count(path, int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        planes = {name: np.array(channel.pixels) for name, channel in channels.items()}
        if "Z" in planes or len(planes) == 1:
            return planes.get("Z", next(iter(planes.values())))
        if {"R", "G", "B"} <= planes.keys() and _all_equal([planes[name] for name in "RGB"]):
            return np.stack([planes[name] for name in "RGB"], axis=-1)
        raise FileFormatError(
            f"{path}: has channels {', '.join(planes)}; depth is one channel, or one named Z, or "
            "equal R, G, B"
        )


def _all_equal(planes: list[NDArray[Any]]) -> bool:
    return all(np.array_equal(plane, planes[0], equal_nan=True) for plane in planes)


_READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".png": read_pixels,
    ".tif": read_pixels,
    ".tiff": read_pixels,
    ".npy": load_array,
    ".exr": _read_exr,
    ".pgm": lambda path: read_netpbm(path)[0],
    ".pfm": read_pfm,
    ".csv": _read_csv,
    ".raw": _read_raw,
    **dict.fromkeys(HEIF_SUFFIXES, read_heif_depth),
}
DEPTH_SUFFIXES = (*_READERS, *_ARCHIVES)
