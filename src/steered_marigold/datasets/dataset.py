"""The one interface of every data set, and the choice of its frames."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from jaxtyping import Float, UInt8
from torch import Tensor

from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, InputError, SizeMismatchError


@runtime_checkable
class Dataset(Protocol):
    """Frames with their ground truth, read one at a time; picklable, so that workers share it.

    `name` is the data set's name on the command line; `frame_ids` are unique and sorted.
    """

    @property
    def name(self) -> str: ...

    @property
    def frame_ids(self) -> tuple[str, ...]: ...

    def load(self, frame_id: str) -> Sample:
        """One frame. Raises FileFormatError or SizeMismatchError, naming the file."""
        ...


def select_frames(
    dataset: Dataset, *, frames_file: Path | None = None, limit: int | None = None
) -> tuple[str, ...]:
    """Frame ids to use: all, or those listed in a file (one a line), thinned evenly to `limit`.

    Raises InputError for an id that the data set does not have, an empty list, or a limit below 1.
    """
    frame_ids = dataset.frame_ids
    if frames_file is not None:
        try:
            wanted = set(frames_file.read_text(encoding="utf-8").split())
        except (OSError, UnicodeDecodeError) as error:
            raise FileFormatError(
                f"{frames_file}: cannot be read as a list of frames ({error})"
            ) from error
        unknown = sorted(wanted - set(frame_ids))
        if unknown:
            raise InputError(
                f"{frames_file}: {len(unknown)} frames are not in {dataset.name}, "
                f"first {unknown[0]!r}"
            )
        frame_ids = tuple(sorted(wanted))
    if not frame_ids:
        raise InputError(f"{frames_file or dataset.name}: holds no frames")
    if limit is None or limit >= len(frame_ids):
        return frame_ids
    if limit < 1:
        raise InputError(f"limit must be at least 1, not {limit}")
    return tuple(frame_ids[(2 * i + 1) * len(frame_ids) // (2 * limit)] for i in range(limit))


def files_by_stem(folder: Path, suffixes: Sequence[str]) -> dict[str, Path]:
    """The files of a folder that have one of the suffixes, by their name without it, sorted.

    Raises FileFormatError if there is no such folder, or two files share a stem.
    """
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: no such folder")
    files: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in suffixes and not path.name.startswith("."):
            if path.stem in files:
                raise FileFormatError(
                    f"{path}: {files[path.stem].name} has the same stem; keep one"
                )
            files[path.stem] = path
    return files


def check_sizes(
    where: Path | str,
    image: UInt8[Tensor, "height width 3"],
    depth: Float[Tensor, "depth_height depth_width"],
) -> None:
    """SizeMismatchError, saying both sizes, if an image and its depth differ in size."""
    (height, width), (rows, columns) = image.shape[:2], depth.shape
    if (height, width) != (rows, columns):
        raise SizeMismatchError(
            f"{where}: depth has {columns}x{rows} px, its image {width}x{height}; they must agree"
        )
