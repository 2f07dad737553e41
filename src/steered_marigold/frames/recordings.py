"""Frames of recordings: bags of ROS 1, ROS 2 and RealSense cameras."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.core.notices import Notice
from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.errors import SteeredMarigoldError
from steered_marigold.frames.complete import Record, complete_frame
from steered_marigold.frames.outputs import Outputs, save
from steered_marigold.io.bags import (
    CopyRecord,
    ExtraMessage,
    FrameStream,
    RecordedFrame,
    Recording,
    completed_messages,
    copy_with,
)
from steered_marigold.io.files import create_folder, remove_stale
from steered_marigold.io.images import write_image
from steered_marigold.methods.completer import SEED, DepthCompleter


@dataclass(kw_only=True)
class Tally:
    """What became of a recording's frames, as it goes on.

    failed: the frames that could not be completed, and why.
    """

    completed: int = 0
    failed: dict[str, str] = field(default_factory=dict)


OnFrame = Callable[[Record | None, Tally], None]


def complete_recording(
    completer: DepthCompleter,
    recording: Recording,
    frames: FrameStream,
    out_path: Path,
    *,
    uncertainty: bool = False,
    max_uncertainty: float | None = None,
    seed: int = SEED,
    format: str | None = None,
    overwrite: bool = False,
    on_frame: OnFrame = lambda record, tally: None,
) -> tuple[CopyRecord, Tally]:
    """Copies a recording, with dense depth beside what was measured; see `copy_with`.

    frames: of the recording, those to complete. uncertainty: add it, too. on_frame: gets the record
    of each frame, or None where it failed; one bad frame ends nothing.

    Raises what `copy_with` raises.
    """
    tally = Tally()

    def extra() -> Iterator[ExtraMessage]:
        answers = _answers(
            completer, frames, tally, on_frame, seed=seed, max_uncertainty=max_uncertainty
        )
        for recorded, _, completion, record in answers:
            sigma = completion.uncertainty
            added = completed_messages(
                recorded,
                completion.depth[0],
                sigma[0] if uncertainty and sigma is not None else None,
            )
            if added.lost:
                text = f"{added.lost} depths do not fit the encoding and were written as missing"
                record = record.extended({}, Notice("unrepresentable", text))
            on_frame(record, tally)
            yield from added.messages

    copied = copy_with(recording, out_path, extra(), format=format, overwrite=overwrite)
    return copied, tally


def save_recording(
    completer: DepthCompleter,
    frames: FrameStream,
    folder: Path,
    *,
    max_uncertainty: float | None = None,
    seed: int = SEED,
    on_frame: OnFrame = lambda record, tally: None,
) -> Tally:
    """Writes the frames as files instead: image/, depth/ and uncertainty/, named by their stamps.

    Temporary files that a run left there an hour ago or longer are removed.

    Raises InputError if the folder cannot be written to.
    """
    tally = Tally()
    for name in ("image", "depth", "uncertainty"):
        create_folder(folder / name)
        remove_stale(folder / name)
    answers = _answers(
        completer, frames, tally, on_frame, seed=seed, max_uncertainty=max_uncertainty
    )
    for _, frame, completion, record in answers:
        known = completion.uncertainty is not None
        outputs = Outputs(
            depth=folder / "depth" / f"{frame.id}.png",
            uncertainty=folder / "uncertainty" / f"{frame.id}.png" if known else None,
        )
        write_image(folder / "image" / f"{frame.id}.png", frame.image)
        written, notices = save(completion, frame, outputs)
        on_frame(record.extended(written, *notices), tally)
    return tally


def _answers(
    completer: DepthCompleter,
    frames: FrameStream,
    tally: Tally,
    on_frame: OnFrame,
    *,
    seed: int,
    max_uncertainty: float | None,
) -> Iterator[tuple[RecordedFrame, Frame, DepthCompletion, Record]]:
    """The frames that can be completed; of the others `on_frame` gets None, the tally a line."""
    for recorded in frames:
        try:
            frame = recorded_frame(recorded)
            completion, record = complete_frame(
                completer, frame, seed=seed, max_uncertainty=max_uncertainty
            )
        except (SteeredMarigoldError, RuntimeError, ValueError) as error:
            tally.failed[str(recorded.stamp_ns)] = str(error)
            on_frame(None, tally)
            continue
        tally.completed += 1
        yield recorded, frame, completion, record
