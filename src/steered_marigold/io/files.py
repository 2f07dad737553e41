"""Opening and writing files without surprises: clear errors, whole files or none."""

import os
import re
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.remote import RemotePath

MAX_PIXELS = 100_000_000
_TEMPORARY = re.compile(r"\..*\.[0-9a-f]{8}\.(tmp|old)(\.[^.]+)?")
_LONGEST_STEM = 40  # characters; names are limited to 255 bytes, and these get longer
_HOUR_S = 3600.0
AnyPath = str | os.PathLike[str]


def split_name(name: str) -> tuple[str, str]:
    """Stem and suffix of a file's name, as a Path has them, without making one of each name."""
    stem, dot, ending = name.rpartition(".")
    return (stem, dot + ending) if stem else (name, "")


def names_in(folder: Path) -> Iterator[str]:
    """Of a folder's entries, in any order. Raises OSError if there is no folder."""
    if isinstance(folder, RemotePath):
        yield from (path.name for path in folder.iterdir())
        return
    with os.scandir(folder) as entries:
        yield from (entry.name for entry in entries)


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
    if isinstance(path, RemotePath):  # only writing tells
        return
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
    except UnidentifiedImageError as error:  # its own words name an object of Python
        reason = "no known format of images"
        raise FileFormatError(f"{path}: damaged, or not of its kind ({reason})") from error
    except Exception as error:  # decoders raise everything from SyntaxError to RuntimeError
        raise FileFormatError(f"{path}: damaged, or not of its kind ({error})") from error


@contextmanager
def atomic_write(path: AnyPath) -> Iterator[Path]:
    """A temporary path beside `path`, with its extension; renamed to `path` at the block's end.

    As atomic_writes, for one file.
    """
    with atomic_writes([path]) as (temporary,):
        yield temporary


@contextmanager
def atomic_writes(paths: Sequence[AnyPath]) -> Iterator[list[Path]]:
    """Temporary paths beside `paths`, with their extensions; all renamed at the block's end.

    The last path is renamed last, so that it may stand for the others. If anything fails nothing
    new is left behind and older files are as they were. A link stays one: what it leads to is
    written; what is no regular file, such as a device, is written into. Of a URL the temporary path
    is on this machine, and becomes a whole object; those that were put before one that fails stay.

    Raises InputError, naming the path, if the system refuses to write there.
    """
    if any(isinstance(path, RemotePath) for path in paths):
        with _staged(paths) as temporaries:
            yield temporaries
        return
    targets = [Path(path).resolve() if Path(path).is_symlink() else Path(path) for path in paths]
    temporaries = [
        _beside(Path(path) if _is_special(target) else target, "tmp")
        for path, target in zip(paths, targets, strict=True)
    ]
    try:
        with named_as(dict(zip(temporaries, paths, strict=True))):
            yield temporaries
        _rename_all(temporaries, targets)
    except OSError as error:
        # a writer that does not tell its file was most likely at the first
        path = paths[_index_of(error, temporaries)]
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written ({reason})") from error
    finally:
        for temporary in temporaries:
            temporary.unlink(missing_ok=True)


@contextmanager
def named_as(names: Mapping[Path, AnyPath]) -> Iterator[None]:
    """An InputError inside the block tells of the files by these other names."""
    try:
        yield
    except InputError as error:
        message = str(error)
        for path, name in names.items():
            message = message.replace(str(path), str(name))
        raise type(error)(message) from error


@contextmanager
def _staged(paths: Sequence[AnyPath]) -> Iterator[list[Path]]:
    """As atomic_writes; files of this machine first, then the objects in their order."""
    with TemporaryDirectory(prefix="steered-marigold-") as folder:
        files = [
            Path(folder, f"{index}{path.suffix}") if isinstance(path, RemotePath) else Path(path)
            for index, path in enumerate(paths)
        ]
        with named_as(dict(zip(files, paths, strict=True))), atomic_writes(files) as temporaries:
            yield temporaries
        for file, path in zip(files, paths, strict=True):
            if isinstance(path, RemotePath):
                path.write_bytes(file.read_bytes())


def stale_temporaries(folder: AnyPath, *, older_than_s: int | float = _HOUR_S) -> list[Path]:
    """What a run that was killed left in `folder`: safe to remove, no run is still writing it.

    Temporary files whose last change is at least older_than_s seconds ago. A frame whose outputs
    were being renamed then may have its old version among them, as .NAME.xxxxxxxx.old.
    """
    now = time.time()
    return sorted(
        path
        for path in Path(folder).iterdir()
        if _TEMPORARY.fullmatch(path.name) and now - path.lstat().st_mtime >= older_than_s
    )


def remove_stale(folder: AnyPath, *, older_than_s: int | float = _HOUR_S) -> None:
    """Removes the `stale_temporaries` of a folder."""
    for left in stale_temporaries(folder, older_than_s=older_than_s):
        left.unlink(missing_ok=True)


def _beside(path: Path, mark: str) -> Path:
    return path.with_name(
        f".{path.stem[:_LONGEST_STEM]}.{uuid.uuid4().hex[:8]}.{mark}{path.suffix}"
    )


def _is_special(path: Path) -> bool:
    """Whether a device, pipe or the like is there, which a renamed file would replace."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _kept(target: Path) -> Path | None:
    """A second name of the older file, to restore it by; None if there is none."""
    if not target.is_file():
        return None
    old = _beside(target, "old")
    try:
        old.hardlink_to(target)
    except OSError:  # file systems without links
        old.write_bytes(target.read_bytes())
    return old


def _rename_all(temporaries: Sequence[Path], targets: Sequence[Path]) -> None:
    """Each temporary becomes its target, in order; if one cannot, none does."""
    done: list[tuple[Path, Path | None]] = []
    try:
        for temporary, target in zip(temporaries, targets, strict=True):
            done.append((target, _kept(target)))
            if _is_special(target):
                _write_into(target, temporary)
            else:
                temporary.replace(target)
    except BaseException:
        for target, old in done:
            _restore(target, old)
        raise
    for _, old in done:
        if old is not None:
            old.unlink()


def _write_into(device: Path, temporary: Path) -> None:
    try:
        with device.open("wb") as file:
            file.write(temporary.read_bytes())
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(temporary)) from error


def _restore(target: Path, old: Path | None) -> None:
    """Brings back the older file, or none if there was none."""
    if old is not None:
        old.replace(target)
        old.unlink(missing_ok=True)  # two names of one file both stay after a rename
    elif target.is_file():
        target.unlink()


def _index_of(error: OSError, temporaries: Sequence[Path]) -> int:
    """Which of the temporaries the error names; 0 if none."""
    names = [str(temporary) for temporary in temporaries]
    told = [name for name in (error.filename, error.filename2) if name in names]
    return names.index(told[0]) if told else 0


def write_figure(path: AnyPath, figure: Any, **how: Any) -> None:
    """Writes a matplotlib figure; how: what its `savefig` takes. Raises as `atomic_write` does."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, **how)


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
