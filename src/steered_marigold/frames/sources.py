"""Where frames come from: one frame's files, or folders of them."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.frame import Frame, implausible_median
from steered_marigold.core.registration import register_depth
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from steered_marigold.io.confidence_maps import CONFIDENCE_SUFFIXES, read_confidence
from steered_marigold.io.depth_maps import DEPTH_SUFFIXES, read_depth
from steered_marigold.io.images import IMAGE_SUFFIXES, read_image


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How files are read; see `read_depth`.

    registered: the depth map has a lower resolution and an equal view. K: intrinsics of the image
    [px]. no_measurements: a frame in which nothing was measured is a frame all the same.
    """

    depth_scale: float | None = None
    max_depth: float | None = None
    registered: bool = False
    K: Float[Tensor, "3 3"] | None = None
    no_measurements: bool = False

    def __post_init__(self) -> None:
        for name in ("depth_scale", "max_depth"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise InputError(f"`{name}` must be a positive number, not {value}")


@dataclass(frozen=True, kw_only=True)
class FrameFiles:
    """The files of a frame; or, for many, their folders. depth: None if nothing was measured."""

    image: Path
    depth: Path | None = None
    confidence: Path | None = None

    def given(self) -> list[Path]:
        """The paths that are not None."""
        return [path for path in (self.image, self.depth, self.confidence) if path is not None]


class FrameSource(Protocol):
    """Frames that are read one at a time; picklable, so that workers share it."""

    @property
    def ids(self) -> Sequence[str]:
        """Of the frames, unique, in order."""
        ...

    def load(self, frame_id: str) -> Frame:
        """One frame. Raises InputError, naming the file, if it cannot be used."""
        ...


@dataclass(frozen=True, kw_only=True)
class FileSource:
    """Frames of files. lone: what has no counterpart, and why, a sentence each."""

    files: dict[str, FrameFiles]
    reading: Reading
    lone: list[str] = field(default_factory=list)

    @property
    def ids(self) -> list[str]:
        """Of the frames: the stems of their images."""
        return list(self.files)

    def load(self, frame_id: str) -> Frame:
        """See `read_frame`."""
        return read_frame(self.files[frame_id], self.reading, frame_id)

    def __iter__(self) -> Iterator[Frame]:
        return map(self.load, self.files)


def folder_source(folders: FrameFiles, reading: Reading) -> FileSource:
    """The frames of two folders (three with confidences), paired by stem.

    Raises InputError if one is no folder, or if there is no pair.
    """
    for folder in folders.given():
        if not folder.is_dir():
            raise InputError(f"{folder}: {folders.image} is a folder, so this must be one too")
    files, lone = _pair_by_stem(folders)
    return FileSource(files=files, reading=reading, lone=lone)


def read_frame(files: FrameFiles, reading: Reading, frame_id: str | None = None) -> Frame:
    """The frame's files, checked against each other; InputError where they cannot be used."""
    frame_id = files.image.stem if frame_id is None else frame_id
    if files.depth is None:
        image = read_image(files.image)
        nothing = torch.zeros(image.shape[:2])
        return Frame(
            image=image, sparse_depth=nothing, valid_mask=nothing > 0, K=reading.K, id=frame_id
        )
    measured = read_depth(files.depth, depth_scale=reading.depth_scale, max_depth=reading.max_depth)
    if not measured.valid_mask.any() and not reading.no_measurements:
        raise NoMeasurementsError(
            f"{files.depth}: no valid pixel ({_reasons(measured.missing)}); "
            "`no_measurements` gives relative depth from the image alone"
        )
    confidence = None if files.confidence is None else read_confidence(files.confidence)
    if confidence is not None and confidence.shape != measured.depth.shape:
        raise SizeMismatchError(
            f"{files.confidence} is {_size(confidence)} but {files.depth} {_size(measured.depth)}"
        )
    image = read_image(files.image)
    depth, valid_mask = measured.depth, measured.valid_mask
    if reading.registered:
        moved = register_depth(depth, valid_mask, (image.shape[0], image.shape[1]))
        depth, valid_mask = moved.depth, moved.valid_mask
        confidence = None if confidence is None else moved.carry(confidence)
    elif image.shape[:2] != depth.shape:
        raise _other_size(files, image[..., 0], depth)
    return Frame(
        image=image,
        sparse_depth=depth,
        valid_mask=valid_mask,
        confidence=confidence,
        K=reading.K,
        id=frame_id,
        missing=vars(measured.missing),
        notices=implausible_median(depth, valid_mask),
    )


def _pair_by_stem(folders: FrameFiles) -> tuple[dict[str, FrameFiles], list[str]]:
    """The frames of the folders by stem, in order, and why other stems make no frame.

    Raises InputError if there is no frame at all.
    """
    image_files = _by_stem(folders.image, IMAGE_SUFFIXES)
    depth_files = _by_stem(folders.depth, DEPTH_SUFFIXES)
    confidence_files = _by_stem(folders.confidence, CONFIDENCE_SUFFIXES)
    frames: dict[str, FrameFiles] = {}
    lone: list[str] = []
    for stem in sorted(image_files.keys() | depth_files.keys()):
        try:
            frames[stem] = FrameFiles(
                image=_only(image_files[stem], folders.image, stem),
                depth=folders.depth and _only(depth_files[stem], folders.depth, stem),
                confidence=folders.confidence
                and _only(confidence_files[stem], folders.confidence, stem),
            )
        except InputError as error:
            lone.append(str(error))
    if not frames:
        raise InputError(
            f"{' and '.join(map(str, folders.given()))}: no files with equal stems; "
            "an image a/0001.jpg belongs to the depth map b/0001.png"
        )
    return frames, lone


def _by_stem(folder: Path | None, suffixes: Sequence[str]) -> defaultdict[str, list[Path]]:
    """The folder's visible files of these kinds."""
    files: defaultdict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.iterdir()) if folder is not None else []:
        if path.suffix.lower() in suffixes and not path.name.startswith("."):
            files[path.stem].append(path)
    return files


def _only(files: list[Path], folder: Path, stem: str) -> Path:
    if len(files) != 1:
        found = ", ".join(path.name for path in files) or "nothing"
        raise InputError(f"{folder / stem}.*: exactly one file is needed, found {found}")
    return files[0]


def _other_size(files: FrameFiles, image: Tensor, depth: Tensor) -> SizeMismatchError:
    """Names both sizes, and the likeliest way out."""
    advice = "`depth_grid=registered` takes a depth map of lower resolution and equal view"
    if image.shape == depth.shape[::-1]:
        advice = "one of them is turned by 90 degrees (the image's EXIF orientation was applied)"
    return SizeMismatchError(
        f"{files.image} is {_size(image)} but {files.depth} {_size(depth)}; {advice}"
    )


def _size(array: Tensor) -> str:
    height, width = array.shape
    return f"{width}x{height}"


def _reasons(missing: object) -> str:
    return ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in vars(missing).items() if n)
