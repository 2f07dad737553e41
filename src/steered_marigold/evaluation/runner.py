"""Runs methods on frames, in this process or in several, and remembers each answer's errors."""

import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from jaxtyping import Float
from torch import Tensor

from steered_marigold.batch.engines import Engine, LocalEngine
from steered_marigold.batch.leftovers import at_work
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.errors import CheckpointError, InputError, SteeredMarigoldError
from steered_marigold.evaluation.predictions import Predictions
from steered_marigold.evaluation.protocols import PreparedFrame, frame_generator, prepare
from steered_marigold.evaluation.results import ImageResult, ResultLog, score
from steered_marigold.evaluation.settings import MethodFactory, RunSettings
from steered_marigold.methods.completer import DepthCompleter

_MAY_CHANGE = ("methods", "frames")

Task = tuple[str, str]
OnResult = Callable[[ImageResult, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run: results of all methods that could run, by method, in order of frame id.

    described: what each method ran as, see `DepthCompleter.describe`. left_out: why a method could
    not run, by method.
    """

    settings: RunSettings
    results: dict[str, list[ImageResult]]
    described: dict[str, dict[str, Any]]
    left_out: dict[str, str]
    workers: int
    threads_per_worker: int

    @property
    def failures(self) -> list[ImageResult]:
        """Images without an answer."""
        return [result for results in self.results.values() for result in results if result.error]


class Evaluator:
    """Completes and scores one image after the other; keeps the last method that it used.

    create: makes a method from its name, by default `create_method` with the run's settings.
    predictions: where the answers are kept; None keeps none.
    """

    def __init__(
        self,
        settings: RunSettings,
        create: MethodFactory | None = None,
        predictions: Predictions | None = None,
    ) -> None:
        self.settings = settings
        self.predictions = predictions
        self._dataset = settings.open_dataset()
        self._create = create or settings.method_factory()
        self._method: tuple[str, DepthCompleter] | None = None

    def prepare(self, frame_id: str) -> PreparedFrame:
        """The frame as methods see it."""
        sample = self._dataset.load(frame_id)
        return prepare(sample, self.settings.protocol, seed=self.settings.seed)

    def method(self, label: str) -> DepthCompleter:
        """The method of a row of the tables; the one before it is let go of."""
        if self._method is None or self._method[0] != label:
            self._method = None  # two checkpoints may not fit into memory
            self._method = label, self._create(label)
        return self._method[1]

    def complete(self, label: str, frame: PreparedFrame) -> DepthCompletion:
        """The method's answer; all methods draw from the same random numbers of the frame."""
        generator = frame_generator(self.settings.seed, frame.shown.id, "method")
        return self.method(label).answer(frame.shown, generator=generator)

    def depth(self, label: str, frame: PreparedFrame) -> Float[Tensor, "height width"]:
        """The method's depth [m]: the kept one, or that of a new completion."""
        kept = None
        if self.predictions is not None:
            kept = self.predictions.read(label, frame.shown.id)
        return self.complete(label, frame).depth[0].cpu() if kept is None else kept

    def evaluate(self, label: str, frame_id: str) -> ImageResult:
        """The errors of one image; whatever goes wrong with it is part of the result."""
        self.method(label)
        try:
            frame = self.prepare(frame_id)
            started = perf_counter()
            completion = self.complete(label, frame)
            seconds = perf_counter() - started
            official = self.settings.official_metrics
            result = score(completion, frame, method=label, seconds=seconds, official=official)
            if self.predictions is not None:
                self.predictions.write(label, frame_id, completion.depth[0].cpu())
            return result
        except Exception as error:  # one bad image must not end a run of hours
            message = str(error) if isinstance(error, SteeredMarigoldError) else repr(error)
            return ImageResult(
                method=label, frame_id=frame_id, areas={}, error=" ".join(message.split())
            )


def run_evaluation(
    settings: RunSettings,
    folder: Path,
    *,
    create: MethodFactory | None = None,
    engine: Engine | None = None,
    overwrite: bool = False,
    keep_predictions: bool = True,
    on_result: OnResult = lambda result, done, total: None,
    warn: Callable[[str], None] = lambda sentence: None,
) -> Run:
    """Completes and scores every frame with every method, and keeps the results in `folder`.

    A run that was stopped goes on where it was; images that failed are tried again. More frames
    or methods may be added to a folder, all else must be the same. engine: None is this process;
    `create` must be picklable for others. `keep_predictions`: see `Predictions`. `on_result` gets
    each result, how many are done, and of how many; `warn` a sentence for each method left out.

    Raises InputError if the folder holds another run (unless `overwrite`), CheckpointError if no
    method can run, SteeredMarigoldError if a worker dies before it is ready.
    """
    predictions = Predictions(settings, folder) if keep_predictions else None
    evaluator = Evaluator(settings, create, predictions)
    described, left_out = _try_methods(evaluator)
    for label, reason in left_out.items():
        warn(f"{label} is left out: {reason}")
    labels = [label for label in settings.methods if label not in left_out]
    if not labels:
        raise CheckpointError(f"no method can run: {'; '.join(left_out.values())}")
    log = _open_log(settings, folder, overwrite=overwrite)
    results = {task: result for task, result in log.read().items() if result.error is None}
    wanted = [(label, frame) for label in labels for frame in settings.frames]
    todo = [task for task in wanted if task not in results]
    engine = engine or LocalEngine()
    start = partial(_Work, settings, create, predictions)
    work = (lambda: lambda task: evaluator.evaluate(*task)) if engine.in_process else start
    folders = [folder, *(predictions.folders() if predictions else ())]
    with at_work(log.path, folders), closing(engine.work(work, todo, lost=_lost)) as outcomes:
        for done, result in enumerate(outcomes, start=len(wanted) - len(todo) + 1):
            log.append(result)
            results[result.method, result.frame_id] = result
            on_result(result, done, len(wanted))
    return Run(
        settings=settings,
        results={label: [results[label, frame] for frame in settings.frames] for label in labels},
        described=described,
        left_out=left_out,
        workers=engine.workers,
        threads_per_worker=engine.threads,
    )


def _try_methods(evaluator: Evaluator) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """What each method runs as, and why others cannot; wrong names are told before any work."""
    described, missing = {}, {}
    for label in reversed(evaluator.settings.methods):  # the first one is then ready
        try:
            described[label] = evaluator.method(label).describe()
        except CheckpointError as error:
            missing[label] = str(error)
    return described, missing


def _open_log(settings: RunSettings, folder: Path, *, overwrite: bool) -> ResultLog:
    """The folder's log, after a check that it belongs to these settings."""
    log = ResultLog(folder / "results.jsonl")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if overwrite and log.path.is_file():
            log.path.unlink()
            shutil.rmtree(Predictions(settings, folder).folder, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot hold a run ({error.strerror})") from error
    if log.path.is_file():
        before, now = RunSettings.load(folder).to_json(), settings.to_json()
        changed = [key for key in now if key not in _MAY_CHANGE and before[key] != now[key]]
        if changed:
            raise InputError(
                f"{folder}: holds a run with another {', '.join(changed)}; "
                "choose another folder, or `overwrite`"
            )
    settings.save(folder)
    return log


def _lost(task: Task, reason: str) -> ImageResult:
    """Of an image that took its process down."""
    label, frame_id = task
    return ImageResult(method=label, frame_id=frame_id, areas={}, error=reason)


class _Work:
    """An evaluator of a process's own."""

    def __init__(
        self, settings: RunSettings, create: MethodFactory | None, predictions: Predictions | None
    ) -> None:
        self._evaluator = Evaluator(settings, create, predictions)

    def __call__(self, task: Task) -> ImageResult:
        return self._evaluator.evaluate(*task)
