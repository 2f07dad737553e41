"""What a visitor chooses, as a frame: a sample, uploads, or files on the server's disk."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any

from PIL import Image, UnidentifiedImageError

from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError
from steered_marigold.frames.sources import (
    FileSource,
    FrameFiles,
    Reading,
    folder_source,
    read_frame,
)
from steered_marigold.io.depth_files import is_depth_name, load_depth_file
from steered_marigold.io.images import IMAGE_SUFFIXES
from steered_marigold.io.intrinsics import read_intrinsics

_ASSETS = Path(str(files("steered_marigold") / "assets"))
SAMPLES = {
    "Room": _ASSETS / "sample",
    "Office": _ASSETS / "samples" / "office",
    "LiDAR lines": _ASSETS / "samples" / "chair",
}
_RECORDINGS = (".bag", ".mcap", ".db3")
_MOST_LISTED = 500


def sample(name: str) -> tuple[FrameFiles, Reading]:
    """The files of a sample, and how they are read."""
    folder = SAMPLES[name]
    reading = Reading(intrinsics=read_intrinsics(folder / "intrinsics.txt"))
    return FrameFiles(image=folder / "image.jpg", depth=folder / "depth.png"), reading


def checked_frame(files: FrameFiles, reading: Reading, *, most_megapixels: float) -> Frame:
    """The frame, if its image is not too large for the page; see `read_frame`."""
    try:
        with Image.open(files.image) as header:  # reads no pixels
            require_megapixels(*header.size, most=most_megapixels)
    except (UnidentifiedImageError, OSError, Image.DecompressionBombError):
        pass  # a format that Pillow does not know, or none: the package's reader says it better
    frame = read_frame(files, reading)
    require_megapixels(frame.size[1], frame.size[0], most=most_megapixels)
    return frame


def require_megapixels(width: int, height: int, *, most: float) -> None:
    """InputError for an image that is larger than this page takes."""
    if width * height > most * 1e6:
        raise InputError(
            f"The image has {width * height / 1e6:.1f} megapixels; this page takes up to "
            f"{most:g}. Make it and its depth map smaller, or use the command "
            "`steered-marigold complete`."
        )


def depth_file(uploads: list[Path]) -> Path | None:
    """The one that holds depth; the others, such as metadata, lie beside it."""
    return next((path for path in uploads if is_depth_name(path.name)), None)


def stored_as(path: Path | None, frame: Frame, reading: Reading) -> str:
    """What the depth file holds and what that was taken for, in words."""
    if not frame.measured:
        return "Nothing was measured: the result will be relative depth, from the image alone."
    measured = frame.sparse_depth[frame.valid_mask]
    span = f"{float(measured.min()):.1f} to {float(measured.max()):.1f} m"
    share = f"{float(frame.valid_mask.float().mean()):.1%} of the pixels measured"
    if path is None:
        return f"From the recording: {span}; {share}."
    kind = load_depth_file(path).dtype
    return f"{kind}, {span} if {_unit(kind, reading)}; {share}."


def _unit(kind: Any, reading: Reading) -> str:
    if reading.depth_encoding != "z":
        return f"encoded as {reading.depth_encoding}"
    if reading.depth_scale is not None:
        return f"one unit is {reading.depth_scale:g} m"
    return "metres" if kind.kind == "f" else "millimetres"


@dataclass(frozen=True, kw_only=True)
class Disk:
    """A folder on the server whose frames visitors may open; nothing outside it."""

    root: Path

    def images(self) -> list[str]:
        """Folders with images, and recordings, relative to the root."""
        folders = [f for f in self._folders() if _holds(f, _is_image)]
        recordings = [p for p in self._visible("**/*") if p.suffix.lower() in _RECORDINGS]
        return self._named(folders + recordings)

    def depths(self) -> list[str]:
        """Folders with files that may hold depth."""
        return self._named([f for f in self._folders() if _holds(f, is_depth_name)])

    def frames(self, images: str, depths: str | None) -> list[str]:
        """The frames of two folders by name, or of a recording by number."""
        path = self._inside(images)
        if path.suffix.lower() not in _RECORDINGS:
            return list(self._source(path, depths).ids)[:_MOST_LISTED]
        from steered_marigold.io.bags import open_recording

        with open_recording(path) as recording:
            return [str(index) for index in range(min(recording.depth_count, _MOST_LISTED))]

    def files(self, images: str, depths: str | None, frame_id: str) -> FrameFiles | None:
        """Of a frame of two folders; None for a recording, which has its own reader."""
        path = self._inside(images)
        if path.suffix.lower() in _RECORDINGS:
            return None
        source = self._source(path, depths)
        if frame_id not in source.files:
            raise InputError(f"{images}: has no frame {frame_id}; choose one of the list")
        return source.files[frame_id]

    def recorded(self, recording: str, index: int, *, most_megapixels: float) -> Frame:
        """A frame of a recording."""
        from steered_marigold.datasets.recording import recorded_frame
        from steered_marigold.io.bags import open_recording

        with open_recording(self._inside(recording)) as opened:
            recorded = next(islice(opened.frames(), index, None), None)
            if recorded is None:
                raise InputError(f"{recording}: has no frame {index}; choose an earlier one")
            frame = recorded_frame(recorded)
        require_megapixels(frame.size[1], frame.size[0], most=most_megapixels)
        return frame

    def _source(self, path: Path, depths: str | None) -> FileSource:
        folders = FrameFiles(image=path, depth=self._inside(depths) if depths else None)
        return folder_source(folders, Reading())

    def _inside(self, name: str) -> Path:
        """InputError for what is not below the root, or goes there by a link."""
        path = (self.root / name).resolve()
        if not path.is_relative_to(self.root.resolve()) or not path.exists():
            raise InputError(f"{name}: is not in the folder that this page was started with")
        return path

    def _folders(self) -> list[Path]:
        return [self.root, *(p for p in self._visible("**/*") if p.is_dir())]

    def _visible(self, pattern: str) -> list[Path]:
        found = (
            path
            for path in self.root.glob(pattern)
            if not any(part.startswith(".") for part in path.relative_to(self.root).parts)
        )
        return sorted(islice(found, 100 * _MOST_LISTED))

    def _named(self, paths: list[Path]) -> list[str]:
        return [str(path.relative_to(self.root)) for path in paths[:_MOST_LISTED]]


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_SUFFIXES


def _holds(folder: Path, wanted: Callable[[Path], bool]) -> bool:
    return any(wanted(path) for path in folder.iterdir())
