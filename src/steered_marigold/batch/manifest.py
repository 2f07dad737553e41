"""The record of a run over many frames: what was made from what, and how.

It lies in `.run`, in the folder of the depth maps: run.json, and records.jsonl with a line a frame;
on object storage, see `remote_records`.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from platform import python_version
from typing import Any

from steered_marigold.batch.job import JobSettings, Outcome, Plan
from steered_marigold.batch.leftovers import at_work
from steered_marigold.batch.remote_records import remote_records
from steered_marigold.diffusion.checkpoint_files import checksum
from steered_marigold.diffusion.checkpoints import checkpoint_folder, parse_device, parse_dtype
from steered_marigold.diffusion.settings import get_preset
from steered_marigold.errors import InputError
from steered_marigold.frames.sources import FrameFiles, Reading
from steered_marigold.io.files import atomic_write, create_folder, decoding
from steered_marigold.io.json_lines import JsonLines
from steered_marigold.io.remote import RemotePath

FOLDER = ".run"
Settings = Mapping[str, Mapping[str, Any]]
_PACKAGES = ("steered-marigold", "torch", "diffusers", "numpy", "scipy", "pillow")


def describe_model(model: Mapping[str, Any]) -> dict[str, Any]:
    """What `SteeredCompleter.from_checkpoint` makes of its arguments, before it loads anything.

    Device and dtype as they will be; the checkpoint by its checksum, wherever it lies.

    Raises InputError for an unknown preset, device or dtype, CheckpointError without a checkpoint.
    """
    device = parse_device(model.get("device"))
    dtype = parse_dtype(model.get("dtype") or get_preset(model["preset"]).dtype, device)
    return {
        **{name: value for name, value in model.items() if name != "checkpoint"},
        "device": str(device),
        "dtype": str(dtype).removeprefix("torch."),
        "checkpoint_sha256": checksum(checkpoint_folder(model["checkpoint"])),
    }


def describe_settings(
    inputs: FrameFiles,
    reading: Reading,
    settings: JobSettings,
    model: Mapping[str, Any],
    suffix: str,
) -> Settings:
    """All that the bytes of results depend on, as values that JSON holds, in four groups.

    model: of `describe_model`; suffix: of depth and uncertainty.
    """
    job = _plain(settings)
    writing = {key: job.pop(key) for key in ("output_scale", "max_uncertainty")}
    resolved = {name: None if p is None else str(p.resolve()) for name, p in vars(inputs).items()}
    return {
        "inputs": resolved,
        "reading": _plain(reading),
        "completing": _plain({**model, **job}),
        "writing": {"output_format": suffix.removeprefix("."), **writing},
    }


def threads_before(folder: Path) -> int | None:
    """Of each worker, in the run that began in a folder; None if there is none."""
    path = folder / FOLDER / "run.json"
    if not path.is_file():
        return None
    with decoding(path):
        return int(_read(path)["settings"]["completing"]["threads"])


def require_same_settings(todo: Plan, settings: Settings) -> None:
    """InputError if the results of a folder were made otherwise, or nobody knows how."""
    folder = todo.folders.depth
    path = folder / FOLDER / "run.json"
    if not path.is_file():
        if todo.skipped:
            raise InputError(
                f"{folder}: holds results of {todo.skipped} frames, and no {FOLDER}/run.json tells "
                "how they were made; `overwrite` makes them anew, or choose another folder"
            )
        return
    with decoding(path):
        before = _read(path)["settings"]
        changed = [
            f"`{key}` ({_short(before[group].get(key))}, now {_short(value)})"
            for group, values in settings.items()
            for key, value in values.items()
            if before[group].get(key) != value
        ]
    if changed:
        raise InputError(
            f"{folder}: its results were made with another {', '.join(changed)}; "
            "`overwrite` makes them anew, or choose another folder"
        )


@contextmanager
def open_run(
    todo: Plan,
    settings: Settings,
    engine: Mapping[str, Any],
    *,
    overwrite: bool,
) -> Iterator[Callable[[Outcome], None]]:
    """Creates the folders and run.json, removes what a killed run left; gives what logs outcomes.

    settings: of `describe_settings`. engine: how this session runs; run.json lists all sessions.
    If the block fails before the first outcome, what was created is gone again.

    Raises InputError if the folder holds a run with other settings and `overwrite` is not asked
    for, or if it cannot be written to.
    """
    if not overwrite:
        require_same_settings(todo, settings)
    run = todo.folders.depth / FOLDER
    folders = [p for p in (*todo.folders.asked().values(), run) if not isinstance(p, RemotePath)]
    created = [folder for folder in folders if not folder.exists()]
    for folder in folders:
        create_folder(folder)
    with at_work(run / "lock", folders) as alone:
        fresh = not (run / "run.json").is_file()
        logged = False

        def append(outcome: Outcome) -> None:
            nonlocal logged
            record = {} if outcome.record is None else outcome.record.to_json()
            error = (
                {} if outcome.error is None else {"image": outcome.frame, "error": outcome.error}
            )
            log(record | error)
            logged = True

        with _records(run, alone=alone, overwrite=overwrite) as log:
            _write(run / "run.json", settings, engine, todo, anew=fresh or overwrite)
            try:
                yield append
            finally:
                if fresh and not logged and not todo.skipped:
                    _remove_created(run, created)


@contextmanager
def _records(
    run: Path, *, alone: bool, overwrite: bool
) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Gives what adds a line to the records in the folder `run`; see `remote_records`."""
    if isinstance(run, RemotePath):
        with remote_records(run, anew=overwrite) as append:
            yield append
        return
    log = JsonLines(run / "records.jsonl")
    if overwrite and alone:
        log.path.unlink(missing_ok=True)
    if log.path.is_file():
        log.drop_unfinished_line()
    yield log.append


def _read(path: Path) -> Any:
    """What a run.json holds."""
    return json.loads(path.read_text(encoding="utf-8"))


def _write(
    path: Path,
    settings: Settings,
    engine: Mapping[str, Any],
    todo: Plan,
    *,
    anew: bool,
) -> None:
    """run.json, with this session added to those before it."""
    session = {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        **engine,
        "frames": todo.total,
        "skipped": todo.skipped,
        "versions": {"python": python_version()} | {name: version(name) for name in _PACKAGES},
    }
    sessions = []
    if not anew:
        with decoding(path):
            sessions = list(_read(path)["sessions"])
    paths = {name: str(folder) for name, folder in todo.folders.asked().items()}
    values = {"settings": settings, "outputs": paths, "paired_by": todo.source.rule or None}
    with atomic_write(path) as temporary:
        temporary.write_text(
            json.dumps(values | {"sessions": [*sessions, session]}, indent=1), encoding="utf-8"
        )


def _remove_created(run: Path, created: list[Path]) -> None:
    """Nothing was made: only files of this module are in the way."""
    for name in ("run.json", "lock"):
        (run / name).unlink(missing_ok=True)
    for folder in reversed(created):
        with suppress(OSError):  # somebody else has put something there
            folder.rmdir()


def _plain(value: Any) -> Any:
    """As JSON holds it."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    return value if isinstance(value, str | int | float | None) else str(value)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
