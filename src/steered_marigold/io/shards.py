"""Shards: many frames in one file, read one frame at a time. WebDataset's tar, and Parquet."""

import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from steered_marigold.errors import FileFormatError, MissingExtraError
from steered_marigold.io.files import decoding, require_file
from steered_marigold.io.remote import RemotePath

TAR, PARQUET = ".tar", ".parquet"

# what the first bytes of a file tell of its extension
_MAGIC = {
    b"\x89PNG": ".png",
    b"\xff\xd8\xff": ".jpg",
    b"II*\0": ".tiff",
    b"MM\0*": ".tiff",
    b"\x93NUMPY": ".npy",
    b"v/1\x01": ".exr",
    b"Pf": ".pfm",
    b"P5": ".pgm",
    b"P6": ".ppm",
    b"RIFF": ".webp",
    b"BM": ".bmp",
}


class TarMember(NamedTuple):
    """A file in a tar: its name, and where its bytes are."""

    name: str
    start: int
    end: int


class ParquetRow(NamedTuple):
    """A row of a Parquet file: its id, the group of rows that it lies in, and where in there."""

    id: str
    group: int
    row: int


def list_tar(path: Path) -> Iterator[TarMember]:
    """The regular files of an uncompressed tar, by one walk through their headers.

    Raises FileFormatError if it is damaged, cut short or compressed.
    """
    with _opened(path) as file, decoding(path), tarfile.open(fileobj=file, mode="r:") as tar:
        for member in tar:
            if member.isreg() and not member.issparse():
                end = member.offset_data + member.size
                name = member.name.removeprefix("./").lstrip("/")
                yield TarMember(name, member.offset_data, end)


def read_member(path: Path, member: TarMember) -> bytes:
    """The bytes of a file in a tar. Raises FileFormatError if the tar has become shorter."""
    if isinstance(path, RemotePath):
        content = path.read_range(member.start, member.end)
    else:
        with decoding(path), path.open("rb") as file:
            file.seek(member.start)
            content = file.read(member.end - member.start)
    if len(content) < member.end - member.start:
        raise FileFormatError(f"{path}: ends within {member.name}; it was changed during the run")
    return content


def parquet_columns(path: Path) -> list[str]:
    """The names of its columns. Raises as `list_parquet` does."""
    with _parquet(path) as file:
        return list(file.schema_arrow.names)


def list_parquet(path: Path) -> Iterator[ParquetRow]:
    """The rows, by the column id alone.

    Raises FileFormatError if the file is damaged or has no ids, MissingExtraError without pyarrow.
    """
    with _parquet(path) as file:
        if "id" not in file.schema_arrow.names:
            found = ", ".join(file.schema_arrow.names)
            raise FileFormatError(f"{path}: has no column id, only {found}; each frame needs one")
        for group in range(file.num_row_groups):
            ids = file.read_row_group(group, columns=["id"], use_threads=False).column("id")
            for row, value in enumerate(ids.to_pylist()):
                if not (name := str("" if value is None else value).lstrip("/")):
                    raise FileFormatError(f"{path}: its column id is empty in row {row} of {group}")
                yield ParquetRow(name, group, row)


def read_row(path: Path, row: ParquetRow, columns: Sequence[str]) -> dict[str, bytes | None]:
    """The bytes in these columns; {"bytes": ...} as the datasets library packs them, too.

    Raises FileFormatError if the file is damaged, or holds no bytes there.
    """
    table = _row_group(path, row.group, tuple(columns))
    contents = {}
    for name in columns:
        value = table.column(name)[row.row].as_py()
        value = value.get("bytes") if isinstance(value, dict) else value
        if value is not None and not isinstance(value, bytes):
            raise FileFormatError(f"{path}: its column {name} does not hold the bytes of files")
        contents[name] = value
    return contents


def suffix_of(content: bytes) -> str | None:
    """The extension of a file that begins so; None for one that is not known."""
    return next((suffix for magic, suffix in _MAGIC.items() if content.startswith(magic)), None)


@lru_cache(maxsize=1)  # the next row is most likely of the same group
def _row_group(path: Path, group: int, columns: tuple[str, ...]) -> Any:
    with _parquet(path) as file:
        return file.read_row_group(group, columns=list(columns), use_threads=False)


@contextmanager
def _parquet(path: Path) -> Iterator[Any]:
    try:
        from pyarrow.parquet import ParquetFile
    except ImportError as error:
        raise MissingExtraError("remote", "pyarrow") from error
    with _opened(path) as file, decoding(path), ParquetFile(file) as parquet:
        yield parquet


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    opened = path.reading() if isinstance(path, RemotePath) else require_file(path).open("rb")
    with opened as file:
        yield file
