"""Object storage, through fsspec: URLs that are paths wherever this package looks at paths."""

import errno
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path, PosixPath
from typing import Any, BinaryIO, NoReturn
from urllib.parse import urlsplit
from urllib.request import url2pathname

from steered_marigold.errors import (
    FileFormatError,
    InputError,
    MissingExtraError,
    SteeredMarigoldError,
)

_URL = re.compile(r"\w[\w+.:-]*://.+")


class RemotePath(PosixPath):
    """An object, or a prefix as a folder: s3://bucket/key, gs://bucket/key, whatever fsspec knows.

    Names, suffixes, parents and `/` are those of paths. Of what paths do with files there is what
    stands here; all else, also what opens a path by itself, raises InputError. So does each of
    these methods, naming the URL, if the storage refuses or cannot be reached.
    """

    __slots__ = ()

    def __str__(self) -> str:
        scheme, _, rest = super().__str__().partition(":/")
        return f"{scheme}://{rest}"

    def __fspath__(self) -> NoReturn:
        raise InputError(f"{self}: is not on this machine; copy it to a disk first")

    def resolve(self, strict: bool = False) -> "RemotePath":
        """Itself: there are no links."""
        return self

    def is_file(self) -> bool:
        """Whether there is such an object."""
        return self._kind() == "file"

    def is_dir(self) -> bool:
        """Whether there is anything below it."""
        return self._kind() == "directory"

    def exists(self) -> bool:
        """Whether it is either."""
        return self._kind() is not None

    def iterdir(self) -> Generator["RemotePath", None, None]:
        """What is below it, by one listing; nothing if there is no such prefix."""
        with _asking(self):
            storage, own = self._opened()
            try:
                paths = storage.ls(own, detail=False)
            except FileNotFoundError:
                return
        own = own.rstrip("/")
        for path in paths:
            if (path := path.rstrip("/")) != own:  # some tools mark a folder by an object
                yield self / path.rpartition("/")[2]

    def read_bytes(self) -> bytes:
        """All of an object. Raises FileFormatError if there is none."""
        return self.read_range(0, None)

    def read_range(self, start: int, end: int | None) -> bytes:
        """Its bytes from start to end. Raises FileFormatError if there is no such object."""
        with _asking(self):
            storage, own = self._opened()
            return bytes(storage.cat_file(own, start=start, end=end))

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """All of an object. Raises FileFormatError if there is none."""
        return self.read_bytes().decode(encoding or "utf-8", errors or "strict")

    @contextmanager
    def reading(self) -> Iterator[BinaryIO]:
        """Opened, to look here and there. Raises FileFormatError if there is no such object."""
        with _asking(self):
            storage, own = self._opened()
            with storage.open(own, "rb") as file:
                yield file

    def write_bytes(self, data: Any) -> int:
        """Puts the whole object, or nothing of it. Whatever stops that would stop all others."""
        storage, own = self._opened()
        try:
            storage.pipe_file(own, bytes(data))
        except Exception as error:  # each storage has its own
            lost = OSError(errno.EIO, _reason(error))
            lost.__cause__ = error
            raise InputError(f"{self}: cannot be written ({_reason(error)})") from lost
        return len(data)

    def unlink(self, missing_ok: bool = False) -> None:
        """Removes an object."""
        with _asking(self):
            storage, own = self._opened()
            try:
                storage.rm_file(own)
            except FileNotFoundError:
                if not missing_ok:
                    raise

    def _kind(self) -> str | None:
        with _asking(self):
            storage, own = self._opened()
            try:
                return str(storage.info(own)["type"])
            except FileNotFoundError:
                return None

    def _opened(self) -> tuple[Any, str]:
        """The file system, which fsspec makes once a process, and this path in its words."""
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise MissingExtraError("remote", "fsspec") from error
        try:
            found: tuple[Any, str] = url_to_fs(str(self), use_listings_cache=False)
        except (ImportError, ValueError) as error:  # "Install s3fs to access S3"
            raise InputError(f"{self}: {_reason(error)}") from error
        return found


def location(text: str) -> Path:
    """A path, or, of a URL, a RemotePath; file:// is a path of this machine.

    Raises InputError for a URL that no path stands for.
    """
    if not _URL.fullmatch(text):
        return Path(text)
    if text.startswith("file://"):
        return Path(url2pathname(urlsplit(text).path))
    path = RemotePath(text)
    if str(path) != text.rstrip("/"):
        raise InputError(f"{text}: a part of the URL is empty or `.`; such names are not read")
    return path


@contextmanager
def _asking(path: RemotePath) -> Iterator[None]:
    """Names the URL in whatever goes wrong between here and the storage."""
    try:
        yield
    except FileNotFoundError as error:
        raise FileFormatError(f"{path}: no such object") from error
    except SteeredMarigoldError:
        raise
    except Exception as error:  # each storage has its own
        raise InputError(f"{path}: cannot be read ({_reason(error)})") from error


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
