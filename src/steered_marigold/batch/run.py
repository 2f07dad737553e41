"""Frames of folders, completed by an engine and recorded."""

from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from functools import partial
from typing import Any

from steered_marigold.batch.engines import Engine, LocalEngine
from steered_marigold.batch.job import FrameWorker, JobSettings, Outcome, Plan, lost
from steered_marigold.batch.manifest import open_run
from steered_marigold.errors import InputError
from steered_marigold.methods.completer import DepthCompleter


def complete_all(
    load: Callable[[], DepthCompleter],
    todo: Plan,
    settings: JobSettings,
    described: Mapping[str, Mapping[str, Any]],
    *,
    engine: Engine | None = None,
    overwrite: bool = False,
) -> Generator[Outcome, None, None]:
    """Completes, writes and records the frames of a plan; what became of each, as they come.

    load: makes the completer, once in each worker; picklable unless the engine is one process.
    described: see `describe_settings`. Ends early where storage gives out: `Outcome.ends_run`.

    Raises what `open_run` raises, and what `load` raises.
    """
    engine = engine or LocalEngine()
    with open_run(todo, described, engine.describe(), overwrite=overwrite) as record:
        if not todo.frames:
            return
        start = partial(FrameWorker, load, settings)
        with closing(engine.work(start, todo.tasks(), lost=lost)) as outcomes:
            for outcome in outcomes:
                if not outcome.ends_run:
                    try:
                        record(outcome)
                    except InputError as error:
                        yield outcome
                        outcome = Outcome(frame=outcome.frame, error=str(error), ends_run=True)
                yield outcome
                if outcome.ends_run:
                    return
