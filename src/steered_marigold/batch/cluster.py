"""Where work is done: on a Ray cluster, by actors of Ray Data."""

import logging
import os
import pickle
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import Any, TypeVar

import torch

from steered_marigold.batch.engines import Engine
from steered_marigold.errors import InputError, MissingExtraError, SteeredMarigoldError

Task = TypeVar("Task")
Result = TypeVar("Result")

# what is done again if an actor dies, and what the driver waits for at a time
BLOCK = 8


class RayEngine(Engine):
    """One model an actor; blocks of tasks go to whichever is free, and to another if it dies."""

    def __init__(
        self, *, address: str | None = None, actors: int | None = None, threads: int = 1
    ) -> None:
        """Connects. address: of a cluster; None begins one on this machine.

        actors: None is one a GPU, or one for each CPU but one, which Ray's own work needs: with
        none free the actors would wait for ever. threads: of each actor on CPUs.

        Raises MissingExtraError without Ray, InputError for more actors than the cluster has room
        for, or if it cannot be reached; SteeredMarigoldError if Ray's own processes do not start.
        """
        try:
            import ray
        except ImportError as error:
            raise MissingExtraError("ray", "ray") from error
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is told to anybody
        try:
            how: dict[str, Any] = {} if address else {"include_dashboard": False}
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, **how)
        except (ConnectionError, ValueError) as error:
            raise InputError(f"`ray_address` {address} cannot be reached: {error}") from error
        except Exception as error:  # Ray has no narrower one for its processes
            raise SteeredMarigoldError(
                f"Ray did not start ({error}); its processes wait for each other for some 30 s, "
                "which may be too short on a busy machine"
            ) from error
        resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        self._gpus = int(resources.get("GPU", 0))
        room = self._gpus or max(1, (int(resources.get("CPU", 1)) - 1) // threads)
        if actors is not None and actors > room:
            raise InputError(
                f"`actors` is {actors}, but the cluster has room for {room}: a GPU each, or "
                f"{threads} CPUs each and one free"
            )
        self.workers, self.threads = actors or room, threads

    def work(
        self,
        start: Callable[[], Callable[[Task], Result]],
        tasks: Iterable[Task],
        *,
        lost: Callable[[Task, str], Result],
    ) -> Generator[Result, None, None]:
        """See `Engine`; tasks lie in the cluster's memory, and none is lost: blocks are retried."""
        import ray

        share: dict[str, Any] = {"num_gpus": 1} if self._gpus else {"num_cpus": self.threads}
        try:
            context = ray.data.DataContext.get_current()
            context.enable_progress_bars = False
            context.print_on_execution_start = False
            logging.getLogger("ray.data").setLevel(logging.ERROR)
            blocks: list[Any] = [ray.put(_table(some)) for some in _blocks(tasks)]
            results = ray.data.from_arrow_refs(blocks).map_batches(
                _Actor,
                fn_constructor_args=(start, self.threads),
                batch_size=None,
                compute=ray.data.ActorPoolStrategy(size=self.workers),
                **share,
            )
            for row in results.iter_rows():
                yield pickle.loads(row["pickled"])
        except ray.exceptions.RayError as error:
            reason = str(error).strip().splitlines()[-1]
            raise SteeredMarigoldError(f"the cluster gave up: {reason}") from error
        finally:
            ray.shutdown()

    def describe(self) -> dict[str, Any]:
        """See `Engine`."""
        return {"engine": "ray", "workers": self.workers, "threads": self.threads}


class _Actor:
    """A worker; made once in its process."""

    def __init__(self, start: Callable[[], Callable[[Any], Any]], threads: int) -> None:
        torch.set_num_threads(threads)
        self._work = start()

    def __call__(self, block: dict[str, Any]) -> dict[str, Any]:
        done = [pickle.dumps(self._work(pickle.loads(task))) for task in block["pickled"]]
        return {"pickled": done}


def _blocks(tasks: Iterable[Task]) -> Generator[list[Task], None, None]:
    upcoming = iter(tasks)
    while some := list(islice(upcoming, BLOCK)):
        yield some


def _table(tasks: Iterable[Any]) -> Any:
    import pyarrow  # comes with Ray Data

    return pyarrow.table({"pickled": [pickle.dumps(task) for task in tasks]})
