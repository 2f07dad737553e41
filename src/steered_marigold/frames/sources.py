"""Where frames come from: one frame's files, or folders of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.doubts import blank_image_doubts, require_another_image, scale_doubts
from steered_marigold.core.edge_agreement import misalignment_doubts
from steered_marigold.core.frame import Frame, in_words
from steered_marigold.core.inversion import inversion_doubts
from steered_marigold.core.notices import Notice
from steered_marigold.core.registration import (
    Registration,
    register_depth,
    register_depth_camera,
)
from steered_marigold.errors import (
    FileFormatError,
    InputError,
    NoMeasurementsError,
    SizeMismatchError,
)
from steered_marigold.io.confidence_maps import CONFIDENCE_SUFFIXES, read_confidence
from steered_marigold.io.depth_files import is_depth_name, require_other_file
from steered_marigold.io.depth_maps import DepthMap, read_depth
from steered_marigold.io.files import named_as, names_in, split_name
from steered_marigold.io.images import IMAGE_SUFFIXES, read_image
from steered_marigold.io.intrinsics import Intrinsics
from steered_marigold.io.pairing import pair_files
from steered_marigold.io.remote import RemotePath
from steered_marigold.io.undistortion import undistort_depth, undistort_image


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How files are read; see `read_depth`.

    registered: the depth map has a lower resolution and an equal view. intrinsics: of the image.
    depth_intrinsics, extrinsics: of a depth map of another camera, and the motion [m] from its
    frame to the image's; both or neither. undistort: take the lens's distortion out of both.
    no_measurements: a frame in which nothing was measured is a frame all the same. slop: time
    stamps [s] of a pair differ by no more; associations: see `pair_files`.
    """

    depth_scale: float | None = None
    max_depth: float | None = None
    depth_encoding: str = "z"
    baseline: float | None = None
    registered: bool = False
    intrinsics: Intrinsics | None = None
    depth_intrinsics: Intrinsics | None = None
    extrinsics: Float[Tensor, "4 4"] | None = None
    undistort: bool = False
    no_measurements: bool = False
    slop: float = 0.02
    associations: Path | None = None

    def __post_init__(self) -> None:
        two = self.depth_intrinsics is not None, self.extrinsics is not None
        if any(two) and not (all(two) and self.intrinsics is not None):
            raise InputError(
                "registering another camera's depth takes `intrinsics`, `depth_intrinsics` and "
                "`extrinsics`"
            )
        if self.undistort and (self.intrinsics is None or self.intrinsics.distortion is None):
            raise InputError("`undistort` needs `intrinsics` with distortion coefficients")


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


class FolderFiles(Mapping[str, FrameFiles]):
    """The files of folders' frames by id, the stem of the image.

    It holds names alone: paths of a million frames would take gigabytes.
    """

    def __init__(
        self,
        folders: FrameFiles,
        depths: Mapping[str, str | None],
        confidences: Mapping[str, str] | None = None,
    ) -> None:
        """depths: names by those of the images. confidences: names by those of the depth maps.

        Raises InputError if two images have one stem: both results would have the same name.
        """
        self.folders, self._depths, self._confidences = folders, depths, confidences or {}
        self._endings = {split_name(image)[1] for image in depths}
        if len(self._endings) > 1:
            seen = set[str]()
            for image in depths:
                if (stem := split_name(image)[0]) in seen:
                    raise InputError(
                        f"{folders.image / image}: another image is named {stem}, too, so both "
                        "would have the same result; rename one"
                    )
                seen.add(stem)

    def __getitem__(self, frame_id: str) -> FrameFiles:
        names = (frame_id + ending for ending in self._endings)
        image = next((name for name in names if name in self._depths), None)
        if image is None:
            raise KeyError(frame_id)
        depth = self._depths[image]
        confidence = None if depth is None else self._confidences.get(depth)
        return FrameFiles(
            image=self.folders.image / image,
            depth=_inside(self.folders.depth, depth),
            confidence=_inside(self.folders.confidence, confidence),
        )

    def __iter__(self) -> Iterator[str]:
        return (split_name(image)[0] for image in self._depths)

    def __len__(self) -> int:
        return len(self._depths)


@dataclass(frozen=True, kw_only=True)
class ListedSource(ABC):
    """A FrameSource that one look has found, to be shared out to workers.

    lone: files that belong to no frame. rule: how those of a frame were put together.
    """

    reading: Reading
    lone: tuple[Path, ...] = field(default=())
    rule: str = ""

    @property
    @abstractmethod
    def ids(self) -> Sequence[str]:
        """See `FrameSource`."""

    @property
    @abstractmethod
    def folders(self) -> Sequence[Path]:
        """Where its files lie."""

    @abstractmethod
    def files_of(self, frame_id: str) -> FrameFiles:
        """What a frame is made of, by the names that records and messages have for it."""

    @abstractmethod
    def reader(self, frame_id: str) -> Callable[[], Frame]:
        """Gives the frame; small, since it is sent to other processes."""

    def load(self, frame_id: str) -> Frame:
        """See `FrameSource`."""
        return self.reader(frame_id)()


@dataclass(frozen=True, kw_only=True)
class FileSource(ListedSource):
    """Frames of files, by id."""

    files: FolderFiles

    @property
    def ids(self) -> list[str]:
        """Of the frames: the stems of their images."""
        return list(self.files)

    @property
    def folders(self) -> list[Path]:
        """See `ListedSource`."""
        return self.files.folders.given()

    def files_of(self, frame_id: str) -> FrameFiles:
        """See `ListedSource`."""
        return self.files[frame_id]

    def reader(self, frame_id: str) -> Callable[[], Frame]:
        """See `ListedSource`."""
        return partial(read_frame, self.files[frame_id], self.reading, frame_id)


def folder_source(folders: FrameFiles, reading: Reading) -> FileSource:
    """The frames of two folders (three with confidences), paired as `pair_files` does.

    Raises InputError if one is no folder, holds no images or no pair, or two images of one stem.
    """
    for folder in folders.given():
        if not folder.is_dir():
            raise InputError(f"{folder}: {folders.image} is a folder, so this must be one too")
    images = _names(folders.image, _with_suffix(IMAGE_SUFFIXES))
    if not images:
        raise InputError(f"{folders.image}: holds no images")
    if folders.depth is None:
        return FileSource(files=FolderFiles(folders, dict.fromkeys(images)), reading=reading)
    pairing = pair_files(
        images,
        _names(folders.depth, is_depth_name),
        one_folder=folders.image == folders.depth,
        slop=reading.slop,
        associations=reading.associations,
    )
    pairs: Mapping[str, str | None] = pairing.pairs
    weights: Mapping[str, str] = {}
    of_images, of_depths = pairing.unpaired
    lone = sorted(
        [folders.image / name for name in of_images] + [folders.depth / name for name in of_depths]
    )
    if folders.confidence is not None:
        depths = list(pairing.pairs.values())
        maps = _names(folders.confidence, _with_suffix(CONFIDENCE_SUFFIXES))
        one_folder = folders.depth == folders.confidence
        weights = pair_files(depths, maps, one_folder=one_folder).pairs
        lone += [folders.image / image for image, depth in pairs.items() if depth not in weights]
        pairs = {image: depth for image, depth in pairs.items() if depth in weights}
    files = FolderFiles(folders, pairs, weights)
    return FileSource(files=files, reading=reading, lone=tuple(lone), rule=pairing.rule)


def read_frame(files: FrameFiles, reading: Reading, frame_id: str | None = None) -> Frame:
    """The frame's files, checked against each other; InputError where they cannot be used."""
    frame_id = files.image.stem if frame_id is None else frame_id
    contents: dict[Path, bytes] = {
        path: path.read_bytes() for path in files.given() if isinstance(path, RemotePath)
    }
    if contents:
        return read_copies(files, contents, reading, frame_id)
    if files.depth is not None:
        require_other_file(files.image, files.depth)
    image = read_image(files.image)
    size = image.pixels.shape[0], image.pixels.shape[1]
    K, notices, pixels = None, image.notes, image.pixels
    if reading.intrinsics is not None:
        K, of_camera = reading.intrinsics.for_image(size)
        notices += of_camera
        distortion = reading.intrinsics.distortion
        if distortion is not None and reading.undistort:
            pixels = undistort_image(pixels, K, distortion)
        elif distortion is not None:
            text = "The lens's distortion was left as it is; `undistort` takes it out."
            notices += (Notice("distorted", text),)
    notices += blank_image_doubts(pixels)
    nothing = torch.zeros(size)
    frame = Frame(
        image=pixels,
        sparse_depth=nothing,
        valid_mask=nothing > 0,
        K=K,
        id=frame_id,
        notices=notices,
    )
    return frame if files.depth is None else _with_depth(frame, files, files.depth, reading)


def read_copies(
    files: FrameFiles, contents: Mapping[Path, bytes], reading: Reading, frame_id: str
) -> Frame:
    """A frame of files that do not lie on this machine, from their contents; see `read_frame`."""
    with TemporaryDirectory(prefix="steered-marigold-") as folder:
        copies = {}
        for index, (path, content) in enumerate(contents.items()):
            if path.suffix.lower() == ".raw":
                raise FileFormatError(f"{path}: raw depth is read from this machine's disks only")
            copies[path] = Path(folder, f"{index}{path.suffix}")
            copies[path].write_bytes(content)
        local = {name: copies.get(path, path) for name, path in vars(files).items()}
        with named_as({copy: path for path, copy in copies.items()}):
            return read_frame(FrameFiles(**local), reading, frame_id)


def _with_depth(frame: Frame, files: FrameFiles, path: Path, reading: Reading) -> Frame:
    """The frame with what was measured, on the image's grid, and what is doubtful about it."""
    depth_camera = reading.depth_intrinsics
    measured = _read_depth(path, reading, frame.K if depth_camera is None else depth_camera.K)
    confidence, notices = None, measured.notes
    if files.confidence is not None:
        weights = read_confidence(files.confidence)
        confidence, notices = weights.confidence, notices + weights.notes
        if confidence.shape != measured.depth.shape:
            raise SizeMismatchError(
                f"{files.confidence} is {_size(confidence)} but {path} {_size(measured.depth)}"
            )
        if measured.valid_mask.any() and not confidence[measured.valid_mask].any():
            raise NoMeasurementsError(f"{files.confidence}: is 0 wherever {path} was measured")
    depth, valid_mask = measured.depth, measured.valid_mask
    moved = _register(frame, measured, reading)
    if moved is not None:
        depth, valid_mask = moved.depth, moved.valid_mask
        confidence = None if confidence is None else moved.carry(confidence)
    elif frame.size != depth.shape:
        raise _other_size(files, frame.image[..., 0], depth)
    elif reading.undistort and reading.intrinsics is not None and frame.K is not None:
        lens = frame.K, reading.intrinsics.distortion or ()
        if confidence is not None:
            confidence, _ = undistort_depth(confidence, valid_mask, *lens)
        depth, valid_mask = undistort_depth(depth, valid_mask, *lens)
    try:
        require_another_image(frame.image, depth, valid_mask)
    except InputError as error:
        raise InputError(f"{files.image}: {error}") from error
    frame = replace(
        frame,
        sparse_depth=depth,
        valid_mask=valid_mask,
        confidence=confidence,
        missing=measured.missing,
        notices=frame.notices + notices,
    ).plausible()
    depth, valid_mask = frame.sparse_depth, frame.valid_mask
    doubts = scale_doubts(depth, valid_mask)
    if not doubts:  # a wrong unit explains the others
        doubts = inversion_doubts(depth, valid_mask)
        doubts += misalignment_doubts(frame.image, depth, valid_mask)
    return replace(frame, notices=frame.notices + doubts)


def _register(frame: Frame, measured: DepthMap, reading: Reading) -> Registration | None:
    """The measurements on the image's grid; None where they lie on it."""
    depth, valid_mask = measured.depth, measured.valid_mask
    if reading.depth_intrinsics is not None and reading.extrinsics is not None:
        assert frame.K is not None  # Reading holds it so
        rows, columns = depth.shape
        depth_K, _ = reading.depth_intrinsics.for_image((rows, columns))
        return register_depth_camera(
            depth,
            valid_mask,
            depth_K=depth_K,
            image_K=frame.K,
            extrinsics=reading.extrinsics,
            size=frame.size,
        )
    return register_depth(depth, valid_mask, frame.size) if reading.registered else None


def _read_depth(path: Path, reading: Reading, K: Float[Tensor, "3 3"] | None) -> DepthMap:
    measured = read_depth(
        path,
        depth_scale=reading.depth_scale,
        max_depth=reading.max_depth,
        depth_encoding=reading.depth_encoding,
        K=K,
        baseline=reading.baseline,
    )
    if not measured.valid_mask.any() and not reading.no_measurements:
        raise NoMeasurementsError(
            f"{path}: no valid pixel ({in_words(measured.missing)}); "
            "`no_measurements` gives relative depth from the image alone"
        )
    return measured


def _with_suffix(suffixes: Sequence[str]) -> Callable[[str], bool]:
    return lambda name: split_name(name)[1].lower() in suffixes


def _names(folder: Path, wanted: Callable[[str], bool]) -> list[str]:
    """Of the folder's visible files of these kinds."""
    names = names_in(folder)
    return sorted(name for name in names if wanted(name) and not name.startswith("."))


def _inside(folder: Path | None, name: str | None) -> Path | None:
    return None if folder is None or name is None else folder / name


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
