"""Opening and writing files without surprises: clear errors, whole files or none."""

import os
import uuid
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from steered_marigold.errors import FileFormatError, InputError

MAX_PIXELS = 100_000_000
AnyPath = str | os.PathLike[str]


def require_suffix(path: AnyPath, suffixes: Sequence[str]) -> str:
    """The lower-case extension of `path`; FileFormatError if it is not one of `suffixes`."""
    suffix = Path(path).suffix.lower()
    if suffix not in suffixes:
        raise FileFormatError(
            f"{path}: unknown extension {suffix!r}; use one of {', '.join(suffixes)}"
        )
    return suffix


def require_file(path: AnyPath) -> Path:
    """`path` if it is a file, else FileFormatError."""
    path = Path(path)
    if not path.is_file():
        what = "is a folder, a file is needed" if path.is_dir() else "no such file"
        raise FileFormatError(f"{path}: {what}")
    return path


def require_writable(path: AnyPath) -> None:
    """InputError if a file cannot be written at `path`: told before the work, not after it."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: cannot be written, it is a folder; name a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written, there is no folder {path.parent}; create it")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: cannot be written, no permission in {path.parent}")


def create_folder(path: AnyPath) -> None:
    """Creates the folder and its parents where needed; InputError if that is impossible."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be a folder ({error.strerror})") from error


def require_pixel_count(path: AnyPath, width: int, height: int) -> None:
    """FileFormatError above MAX_PIXELS; called on the header, before the pixels are decoded."""
    if width * height > MAX_PIXELS:
        raise FileFormatError(
            f"{path}: {width}x{height} is over {MAX_PIXELS // 10**6} megapixels; "
            "resize or crop it first"
        )


@contextmanager
def decoding(path: AnyPath) -> Iterator[None]:
    """Turns whatever a decoder raises inside the block into a FileFormatError naming `path`."""
    try:
        # decoders warn about oddities just before they fail; one clear error is enough
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:  # decoders raise everything from SyntaxError to RuntimeError
        raise FileFormatError(f"{path}: damaged, or not of its kind ({error})") from error


@contextmanager
def atomic_write(path: AnyPath) -> Iterator[Path]:
    """A temporary path beside `path`, with its extension; renamed to `path` at the block's end.

    If the block fails nothing is left behind and an older `path` is untouched.
    Raises InputError if the system refuses to write there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason})") from error
    finally:
        temporary.unlink(missing_ok=True)


def open_picture(path: AnyPath, formats: Sequence[str]) -> Image.Image:
    """A decoded Pillow image of one of Pillow's `formats`, checked for size and damage."""
    path = require_file(path)
    with decoding(path), path.open("rb") as file:
        try:
            header = Image.open(file, formats=list(formats))
        except Image.DecompressionBombError as error:
            raise FileFormatError(f"{path}: {error}; resize or crop it first") from error
        require_pixel_count(path, *header.size)
        header.verify()  # checksums, where the format has them; the image is used up by it
        picture = Image.open(file, formats=list(formats))
        picture.load()
        return picture


def load_array(path: AnyPath) -> NDArray[Any]:
    """The array of a .npy file, without singleton axes beyond two; never a pickle."""
    path = require_file(path)
    with decoding(path):
        # a memory map checks the header against the file's size before any memory is taken
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(array, np.ndarray):
            raise FileFormatError(f"{path}: is an archive of arrays; save one array with np.save")
        require_pixel_count(path, array.size, 1)
        return squeezed(array)


def squeezed(array: NDArray[Any]) -> NDArray[Any]:
    """A copy without singleton axes, as long as two axes are left; the first ones go first."""
    singletons = [axis for axis, size in enumerate(array.shape) if size == 1]
    return np.array(np.squeeze(array, axis=tuple(singletons[: max(array.ndim - 2, 0)])))
