"""Frames one after another in this process."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.frames.complete import Record, complete_frame, require_max_uncertainty
from steered_marigold.frames.outputs import Outputs, save
from steered_marigold.frames.sources import FileSource, FrameFiles
from steered_marigold.io.files import create_folder
from steered_marigold.methods.completer import SEED, DepthCompleter


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
class Plan:
    """frames: what is to do, in order. skipped: how many have their results."""

    source: FileSource
    frames: Mapping[str, Outputs]
    skipped: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Of one frame: its record, or the error that it ended with."""

    frame: str
    record: Record | None = None
    error: str | None = None


def plan(source: FileSource, folders: Outputs, *, suffix: str, overwrite: bool) -> Plan:
    """What is left to do; writes nothing.

    suffix: of depth and uncertainty. Raises InputError if an output would overwrite an input, or
    lie among the inputs, where the next run would take it for one.
    """
    inputs = {path.parent.resolve() for files in source.files.values() for path in files.given()}
    for folder in folders.asked().values():
        if folder.resolve() in inputs:
            raise InputError(f"{folder}: holds inputs; results need a folder of their own")
    frames = {}
    for frame_id, files in source.files.items():
        outputs = folders.of_frame(frame_id, suffix)
        outputs.require_distinct(files)
        if overwrite or not all(path.exists() for path in outputs.asked().values()):
            frames[frame_id] = outputs
    return Plan(source=source, frames=frames, skipped=len(source.files) - len(frames))


def complete_all(completer: DepthCompleter, todo: Plan, settings: JobSettings) -> Iterator[Outcome]:
    """Creates the output folders, then completes and writes frame by frame.

    Raises InputError if a folder cannot be created.
    """
    for folder in {path.parent for out in todo.frames.values() for path in out.asked().values()}:
        create_folder(folder)
    for frame_id, outputs in todo.frames.items():
        files = todo.source.files[frame_id]
        try:
            frame = todo.source.load(frame_id)
            record = complete_to_files(completer, frame, files, outputs, settings)
        except Exception as error:  # one bad frame must not end a run over thousands
            expected = isinstance(error, SteeredMarigoldError)
            yield Outcome(frame=str(files.image), error=str(error) if expected else repr(error))
        else:
            yield Outcome(frame=str(files.image), record=record)


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
