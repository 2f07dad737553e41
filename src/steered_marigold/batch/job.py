"""One of many frames: what is to do, done, and what became of it."""

import errno
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter

from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.frames.complete import Record, complete_frame, require_max_uncertainty
from steered_marigold.frames.outputs import Outputs, save
from steered_marigold.frames.sources import FrameFiles, ListedSource
from steered_marigold.methods.completer import SEED, DepthCompleter

# what stops the writing of one frame and would stop that of all others
_STORAGE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE)


@dataclass(frozen=True, kw_only=True)
class JobSettings:
    """How every frame is completed and written; see `complete_frame` and `save`."""

    seed: int = SEED
    no_measurements: bool = False
    max_uncertainty: float | None = None
    output_scale: float | None = None

    def __post_init__(self) -> None:
        require_max_uncertainty(self.max_uncertainty)


@dataclass(frozen=True, kw_only=True)
class FrameTask:
    """A frame to complete; small, since it is sent to other processes.

    read: gives the frame. files: those it is read from. outputs: those to write.
    """

    files: FrameFiles
    outputs: Outputs
    read: Callable[[], Frame]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Of one frame: its record, or the error that it ended with.

    ends_run: the others could not be written either.
    """

    frame: str
    record: Record | None = None
    error: str | None = None
    ends_run: bool = False


@dataclass(frozen=True, kw_only=True)
class Plan:
    """frames: ids of what is to do, in order. folders, suffix: of the outputs.

    skipped: how many frames have their results.
    """

    source: ListedSource
    folders: Outputs
    suffix: str
    frames: Sequence[str]
    skipped: int

    @property
    def total(self) -> int:
        """How many frames there are; the source would have to list them again."""
        return len(self.frames) + self.skipped

    def tasks(self) -> Iterator[FrameTask]:
        """The frames to do."""
        for frame_id in self.frames:
            outputs = self.folders.of_frame(frame_id, self.suffix)
            files = self.source.files_of(frame_id)
            yield FrameTask(files=files, outputs=outputs, read=self.source.reader(frame_id))


def plan(source: ListedSource, folders: Outputs, *, suffix: str, overwrite: bool) -> Plan:
    """What is left to do; writes nothing.

    suffix: of depth and uncertainty. Raises InputError if an output would overwrite an input, or
    lie among the inputs, where the next run would take it for one.
    """
    ids = source.ids
    if not ids:
        raise InputError("no frames were found")
    inputs = {folder.resolve() for folder in source.folders}
    for folder in folders.asked().values():
        if folder.resolve() in inputs:
            raise InputError(f"{folder}: holds inputs; results need a folder of their own")
    folders.of_frame(ids[0], suffix).require_distinct(source.files_of(ids[0]))
    done = set[str]() if overwrite else folders.done(suffix)
    frames = [frame_id for frame_id in ids if frame_id not in done]
    skipped = len(ids) - len(frames)
    return Plan(source=source, folders=folders, suffix=suffix, frames=frames, skipped=skipped)


class FrameWorker:
    """Completes and writes frames with a model of its own, which `load` makes."""

    def __init__(self, load: Callable[[], DepthCompleter], settings: JobSettings) -> None:
        started = perf_counter()
        self.completer, self.settings = load(), settings
        self.load_seconds = round(perf_counter() - started, 4)

    def __call__(self, task: FrameTask) -> Outcome:
        """Whatever goes wrong with the frame is its outcome."""
        frame = str(task.files.image)
        try:
            task.outputs.require_distinct(task.files)  # links lead anywhere
            record = complete_to_files(
                self.completer, task.read(), task.files, task.outputs, self.settings
            )
        except Exception as error:  # one bad frame must not end a run over thousands
            expected = isinstance(error, SteeredMarigoldError)
            text = " ".join((str(error) if expected else repr(error)).split())
            return Outcome(frame=frame, error=text, ends_run=_of_storage(error))
        return Outcome(frame=frame, record=record.extended({"load_seconds": self.load_seconds}))


def lost(task: FrameTask, reason: str) -> Outcome:
    """Of a frame that took its process down."""
    return Outcome(frame=str(task.files.image), error=reason)


def complete_to_files(
    completer: DepthCompleter,
    frame: Frame,
    files: FrameFiles,
    outputs: Outputs,
    settings: JobSettings,
) -> Record:
    """Completes a frame that was read from `files`, and writes what is asked for."""
    completion, record = complete_frame(
        completer,
        frame,
        seed=settings.seed,
        no_measurements=settings.no_measurements,
        max_uncertainty=settings.max_uncertainty,
    )
    written, notices = save(completion, frame, outputs, output_scale=settings.output_scale)
    paths = {
        "image": str(files.image),
        "depth": None if files.depth is None else str(files.depth),
    }
    return record.extended(paths | written, *notices)


def _of_storage(error: BaseException | None) -> bool:
    """Whether storage that is full, read-only or gone is behind an error."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _STORAGE_ERRORS:
            return True
        error = error.__cause__
    return False
