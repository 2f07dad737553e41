"""Where work is done: in this process, or in several."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

import torch

from steered_marigold.batch.processes import work_in_processes

Task = TypeVar("Task")
Result = TypeVar("Result")


class Engine(ABC):
    """Does tasks, each by itself, so that every engine gives the same results.

    workers: processes. threads: of each; the last bits of a result depend on it, as sums are taken
    in another order then. in_process: the only worker is this process.
    """

    workers: int
    threads: int
    in_process: bool = False

    @abstractmethod
    def work(
        self,
        start: Callable[[], Callable[[Task], Result]],
        tasks: Iterable[Task],
        *,
        lost: Callable[[Task, str], Result],
    ) -> Generator[Result, None, None]:
        """Results as they come, in no order; see `work_in_processes`."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """As values that JSON holds."""


class LocalEngine(Engine):
    """This machine."""

    def __init__(self, *, workers: int = 1, threads: int | None = None) -> None:
        """workers: processes; 1 is this one. threads: of each; None: the cores, divided."""
        self.workers, self.in_process = workers, workers == 1
        self.threads = threads or max(1, torch.get_num_threads() // workers)

    def work(
        self,
        start: Callable[[], Callable[[Task], Result]],
        tasks: Iterable[Task],
        *,
        lost: Callable[[Task, str], Result],
    ) -> Generator[Result, None, None]:
        """See `Engine`."""
        if not self.in_process:
            yield from work_in_processes(
                start, tasks, lost=lost, workers=self.workers, threads=self.threads
            )
        else:
            before = torch.get_num_threads()
            torch.set_num_threads(self.threads)
            try:
                yield from map(start(), tasks)
            finally:
                torch.set_num_threads(before)

    def describe(self) -> dict[str, Any]:
        """See `Engine`."""
        return {"engine": "local", "workers": self.workers, "threads": self.threads}
