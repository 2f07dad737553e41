"""Folder runs: frames paired by stem, one model, every failure counted."""

import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from steered_marigold.cli.frames import Completer, complete_frame, read_frame
from steered_marigold.cli.messages import say_error
from steered_marigold.cli.settings import Inputs, Outputs, Settings, require_consistent
from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.io.confidence_maps import CONFIDENCE_SUFFIXES
from steered_marigold.io.depth_files import DEPTH_SUFFIXES
from steered_marigold.io.files import create_folder
from steered_marigold.io.images import IMAGE_SUFFIXES


@dataclass(frozen=True, kw_only=True)
class Plan:
    """frames: what is to do. skipped: frames that have their results. failed: have no pair."""

    frames: list[tuple[Inputs, Outputs]]
    skipped: int
    failed: int


def plan_folders(
    inputs: Inputs, outputs: Outputs, settings: Settings, *, suffix: str, overwrite: bool
) -> Plan:
    """Pairs the files of the input folders by stem; writes nothing.

    Raises InputError if something is no folder, if there is no pair, or if an output would
    overwrite an input.
    """
    for folder in inputs.given():
        if not folder.is_dir():
            raise InputError(f"{folder}: {inputs.image} is a folder, so this must be one too")
    require_consistent(inputs, outputs.of_frame("frame", suffix), settings)
    pairs, failed = _pair_by_stem(inputs)
    todo = []
    for stem, frame_inputs in pairs.items():
        frame_outputs = outputs.of_frame(stem, suffix)
        frame_outputs.require_distinct(frame_inputs)
        if overwrite or not all(path.exists() for path in frame_outputs.asked().values()):
            todo.append((frame_inputs, frame_outputs))
    return Plan(frames=todo, skipped=len(pairs) - len(todo), failed=failed)


def complete_folders(
    completer: Completer,
    frames: Sequence[tuple[Inputs, Outputs]],
    settings: Settings,
    *,
    report: Callable[[dict[str, Any]], None],
) -> int:
    """Creates the output folders, completes the frames, reports each record.

    Returns how many frames failed. Raises InputError if a folder cannot be created.
    """
    for folder in {path.parent for _, outputs in frames for path in outputs.asked().values()}:
        create_folder(folder)
    failures = 0
    console = Console(stderr=True)
    with Progress(
        console=console,
        disable=not console.is_terminal,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # records in a pipe must not move to the terminal
    ) as progress:
        for inputs, outputs in progress.track(frames, description="completing"):
            try:
                frame = read_frame(inputs, settings)
                record = complete_frame(completer, frame, inputs, outputs, settings)
            except Exception as error:  # one bad frame must not end a run over thousands
                expected = isinstance(error, SteeredMarigoldError)
                say_error(f"{inputs.image}: {error if expected else repr(error)}")
                failures += 1
            else:
                report(record)
    return failures


def _pair_by_stem(folders: Inputs) -> tuple[dict[str, Inputs], int]:
    """The frames of the folders by stem, in order, and how many stems make no frame (said so).

    Raises InputError if there is no frame at all.
    """
    image_files = _by_stem(folders.image, IMAGE_SUFFIXES)
    depth_files = _by_stem(folders.depth, DEPTH_SUFFIXES)
    confidence_files = _by_stem(folders.confidence, CONFIDENCE_SUFFIXES)
    frames: dict[str, Inputs] = {}
    incomplete = 0
    for stem in sorted(image_files.keys() | depth_files.keys()):
        try:
            frames[stem] = Inputs(
                image=_only(image_files[stem], folders.image, stem),
                depth=folders.depth and _only(depth_files[stem], folders.depth, stem),
                confidence=folders.confidence
                and _only(confidence_files[stem], folders.confidence, stem),
            )
        except InputError as error:
            say_error(error)
            incomplete += 1
    if not frames:
        raise InputError(
            f"{' and '.join(map(str, folders.given()))}: no files with equal stems; "
            "an image a/0001.jpg belongs to the depth map b/0001.png"
        )
    return frames, incomplete


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
