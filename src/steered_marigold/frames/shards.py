"""Frames of shards: WebDataset's tar, and Parquet."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from steered_marigold.core.frame import Frame
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.frames.sources import FrameFiles, ListedSource, Reading, read_copies
from steered_marigold.io.confidence_maps import CONFIDENCE_SUFFIXES
from steered_marigold.io.depth_files import is_depth_name
from steered_marigold.io.images import IMAGE_SUFFIXES
from steered_marigold.io.shards import (
    PARQUET,
    TAR,
    ParquetRow,
    TarMember,
    list_parquet,
    list_tar,
    parquet_columns,
    read_member,
    read_row,
    suffix_of,
)

_ROLES = ("image", "depth", "confidence")
_WORDS = {"rgb": "image", "color": "image"} | {role: role for role in _ROLES}
_ALWAYS_DEPTH = (".npy", ".npz", ".exr", ".pfm")


class TarFrame(NamedTuple):
    """Where a frame lies in a tar."""

    shard: Path
    members: tuple[tuple[str, TarMember], ...]  # by role

    def files(self) -> FrameFiles:
        """The names of its files, below the shard's."""
        return FrameFiles(**{role: self.shard / member.name for role, member in self.members})

    def unpacked(self) -> tuple[FrameFiles, dict[Path, bytes]]:
        """Those, and what is in them."""
        contents = {
            self.shard / member.name: read_member(self.shard, member) for _, member in self.members
        }
        return self.files(), contents


class ParquetFrame(NamedTuple):
    """Where a frame lies in a Parquet file."""

    shard: Path
    row: ParquetRow
    columns: tuple[str, ...]

    def files(self) -> FrameFiles:
        """The names of its files, below the shard's."""
        return FrameFiles(**{name: self.shard / self.row.id / name for name in self.columns})

    def unpacked(self) -> tuple[FrameFiles, dict[Path, bytes]]:
        """Those with their extensions, and what is in them."""
        names, contents = {}, {}
        for name, content in read_row(self.shard, self.row, self.columns).items():
            if content is None and name != "image":
                continue
            path = self.shard / self.row.id / name
            suffix = suffix_of(content or b"")
            if content is None or suffix is None:
                raise FileFormatError(f"{path}: is empty, or begins as no file that is read here")
            names[name] = path.with_name(f"{name}{suffix}")
            contents[names[name]] = content
        return FrameFiles(**names), contents


PackedFrame = TarFrame | ParquetFrame


@dataclass(frozen=True, kw_only=True)
class ShardSource(ListedSource):
    """Frames of shards, by id: the key in a tar, the column id in Parquet, with _ for /."""

    frames: dict[str, PackedFrame]
    rule: str = "their keys in shards"

    @property
    def ids(self) -> Sequence[str]:
        """In the order of the shards, and in them."""
        return list(self.frames)

    @property
    def folders(self) -> list[Path]:
        """See `ListedSource`."""
        return sorted({frame.shard.parent for frame in self.frames.values()})

    def files_of(self, frame_id: str) -> FrameFiles:
        """See `ListedSource`."""
        return self.frames[frame_id].files()

    def reader(self, frame_id: str) -> Callable[[], Frame]:
        """See `ListedSource`."""
        return partial(_read_packed, self.frames[frame_id], self.reading, frame_id)


def holds_shards(path: Path) -> bool:
    """Whether a path is a shard by its name, or a folder of shards and no images."""
    if not path.is_dir():
        return path.suffix.lower() in (TAR, PARQUET)
    suffixes = {child.suffix.lower() for child in path.iterdir()}
    return not suffixes.isdisjoint((TAR, PARQUET)) and suffixes.isdisjoint(IMAGE_SUFFIXES)


def shard_source(path: Path, reading: Reading) -> ShardSource:
    """The frames of a shard, or of a folder of them.

    A tar has KEY.jpg and KEY.depth.png for each frame, or KEY.npy, .npz, .exr or .pfm as depth;
    and perhaps KEY.confidence.png. Parquet has the columns id, image, depth and perhaps confidence,
    which hold the bytes of files.

    Raises InputError if two frames have one id, and if a shard cannot be read.
    """
    if reading.associations is not None:
        raise InputError("`associations` is of folders; frames of shards go by their keys")
    shards = [path]
    if path.is_dir():
        shards = sorted(p for p in path.iterdir() if p.suffix.lower() in (TAR, PARQUET))
    frames: dict[str, PackedFrame] = {}
    lone: list[Path] = []
    for shard in shards:
        of_shard = _of_tar if shard.suffix.lower() == TAR else _of_parquet
        for key, frame in of_shard(shard, reading, lone):
            frame_id = key.replace("/", "_")
            if frame_id in frames:
                raise InputError(
                    f"{shard}: its frame {frame_id} is in {frames[frame_id].shard} too; ids must "
                    "differ"
                )
            frames[frame_id] = frame
    return ShardSource(frames=frames, reading=reading, lone=tuple(lone))


def _of_tar(shard: Path, reading: Reading, lone: list[Path]) -> Iterator[tuple[str, PackedFrame]]:
    """Its frames by key; members that make none are added to `lone`."""
    found: dict[str, dict[str, TarMember]] = {}
    for member in list_tar(shard):
        key, role = _key_and_role(member.name)
        if role is not None:
            of_key = found.setdefault(key, {})
            if role in of_key:
                raise InputError(
                    f"{shard}: {of_key[role].name} and {member.name} are both {role} of one frame; "
                    f"depth is told by its name, as {key}.depth.png"
                )
            of_key[role] = member
    for key, of_key in found.items():
        if "image" in of_key and ("depth" in of_key or reading.no_measurements):
            yield key, TarFrame(shard, tuple(of_key.items()))
        else:
            lone.extend(shard / member.name for member in of_key.values())


def _of_parquet(
    shard: Path, reading: Reading, lone: list[Path]
) -> Iterator[tuple[str, PackedFrame]]:
    there = parquet_columns(shard)
    columns = tuple(name for name in _ROLES if name in there)
    for needed in ("image",) if reading.no_measurements else ("image", "depth"):
        if needed not in columns:
            raise FileFormatError(f"{shard}: has no column {needed}, only {', '.join(there)}")
    for row in list_parquet(shard):
        yield row.id, ParquetFrame(shard, row, columns)


def _key_and_role(name: str) -> tuple[str, str | None]:
    """Of a member, as WebDataset splits names: at the first point; None if it is none of ours."""
    folder, slash, base = name.rpartition("/")
    key, _, extension = base.partition(".")
    word, _, suffix = extension.lower().rpartition(".")
    suffix = f".{suffix}"
    role = _WORDS.get(word) if word else "depth" if suffix in _ALWAYS_DEPTH else "image"
    known = {
        "image": suffix in IMAGE_SUFFIXES,
        "depth": is_depth_name(base),
        "confidence": suffix in CONFIDENCE_SUFFIXES,
    }
    return folder + slash + key, role if key and role and known[role] else None


def _read_packed(frame: PackedFrame, reading: Reading, frame_id: str) -> Frame:
    files, contents = frame.unpacked()
    return read_copies(files, contents, reading, frame_id)
