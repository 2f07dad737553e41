"""Where work is done: in this process, or in several."""

from collections.abc import Callable, Generator, Iterable
from typing import Any, Protocol, TypeVar, runtime_checkable

import torch

from steered_marigold.batch.processes import work_in_processes

Task = TypeVar("Task")
Result = TypeVar("Result")


@runtime_checkable
class Engine(Protocol):
    """Does tasks, each by itself, so that every engine gives the same results.

    threads: of each worker. The last bits of a result depend on it, as sums are taken in another
    order then.
    """

    threads: int

    def work(
        self,
        start: Callable[[], Callable[[Task], Result]],
        tasks: Iterable[Task],
        *,
        lost: Callable[[Task, str], Result],
    ) -> Generator[Result, None, None]:
        """Results as they come, in no order; see `work_in_processes`."""
        ...

    def describe(self) -> dict[str, Any]:
        """As values that JSON holds."""
        ...


class LocalEngine:
    """This machine."""

    def __init__(self, *, workers: int = 1, threads: int | None = None) -> None:
        """workers: processes; 1 is this one. threads: of each; None: the cores, divided."""
        self.workers = workers
        self.threads = threads or max(1, torch.get_num_threads() // workers)

    def work(
        self,
        start: Callable[[], Callable[[Task], Result]],
        tasks: Iterable[Task],
        *,
        lost: Callable[[Task, str], Result],
    ) -> Generator[Result, None, None]:
        """See `Engine`."""
        if self.workers > 1:
            yield from work_in_processes(
                start, tasks, lost=lost, workers=self.workers, threads=self.threads
            )
        else:
            torch.set_num_threads(self.threads)
            yield from map(start(), tasks)

    def describe(self) -> dict[str, Any]:
        """See `Engine`."""
        return {"engine": "local", "workers": self.workers, "threads": self.threads}
