"""Work in several processes of this machine; a process that dies costs the task it was at."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar, cast

import torch

from steered_marigold.errors import SteeredMarigoldError

Task = TypeVar("Task")
Result = TypeVar("Result")

_SPAWN = get_context("spawn")
_GRACE_S = 5.0
_NO_MORE: Any = object()
# what the numerical libraries read once, when they are loaded
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def work_in_processes(
    start: Callable[[], Callable[[Task], Result]],
    tasks: Iterable[Task],
    *,
    lost: Callable[[Task, str], Result],
    workers: int,
    threads: int,
) -> Generator[Result, None, None]:
    """Results as they come, in no order. Tasks are drawn as workers get free.

    start: makes what does a task, once in each process; it, tasks and results must be picklable.
    lost: the result of a task whose process died, given why; another process takes its place.
    threads: of each process. Processes end when the iterator is closed, and with this process.

    Raises what `start` raises; SteeredMarigoldError if a process dies before it is ready.
    """
    queue = iter(tasks)
    upcoming = next(queue, _NO_MORE)
    pool: dict[Connection, _Worker] = {}
    with ExitStack() as stack:

        def hire() -> None:
            worker = stack.enter_context(_Worker(start, threads))
            pool[worker.connection] = worker

        for _ in range(workers):
            hire()
        while pool:
            for ready in wait(list(pool)):
                worker = pool[cast(Connection, ready)]
                try:
                    kind, value = worker.connection.recv()
                except (EOFError, ConnectionResetError):
                    del pool[worker.connection]
                    yield lost(worker.task, worker.death())
                    if upcoming is not _NO_MORE:
                        hire()
                    continue
                if kind == "error":
                    raise value
                if kind == "result":
                    yield value
                if upcoming is _NO_MORE:
                    del pool[worker.connection]
                else:
                    worker.give(upcoming)
                    upcoming = next(queue, _NO_MORE)


class _Worker:
    """A process, and the task that it is at."""

    def __init__(self, start: Callable[[], Any], threads: int) -> None:
        self.connection, theirs = _SPAWN.Pipe()
        self._task: Any = None
        self._busy = False
        self._process = _SPAWN.Process(target=_serve, args=(theirs, start, threads), daemon=True)
        with _environment(dict.fromkeys(_THREAD_VARIABLES, str(threads))):
            self._process.start()
        theirs.close()

    def give(self, task: Any) -> None:
        self._task, self._busy = task, True
        with suppress(BrokenPipeError):  # it has died, as the next look at it tells
            self.connection.send(task)

    @property
    def task(self) -> Any:
        """What it was at. Raises SteeredMarigoldError if it never was ready."""
        if not self._busy:
            raise SteeredMarigoldError(
                f"a worker process died before its first frame ({self.death()}), perhaps for lack "
                "of memory; fewer `workers` need less"
            )
        return self._task

    def death(self) -> str:
        """How it ended."""
        self._process.join(_GRACE_S)
        code = self._process.exitcode
        if code is not None and code < 0:
            return f"its process was ended by {signal.Signals(-code).name}"
        return f"its process ended with code {code}"

    def __enter__(self) -> "_Worker":
        return self

    def __exit__(self, *error: object) -> None:
        self._process.terminate()  # temporary files are removed on the way
        self._process.join(_GRACE_S)
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection, start: Callable[[], Callable[[Any], Any]], threads: int) -> None:
    """A worker's whole life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is told to the first process
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        torch.set_num_threads(threads)
        work = start()
    except Exception as error:
        connection.send(("error", error))
        return
    connection.send(("ready", None))
    with suppress(EOFError, BrokenPipeError):
        while True:
            connection.send(("result", work(connection.recv())))


def _leave(*signalled: object) -> None:
    raise SystemExit(0)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """For processes that are started inside the block."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
