"""What commands over many frames share: engines, and how a run ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from time import perf_counter
from typing import TYPE_CHECKING

import typer

from steered_marigold.cli.messages import say
from steered_marigold.errors import InputError

if TYPE_CHECKING:
    from steered_marigold.batch.engines import Engine

TERMINATED = 128 + signal.SIGTERM


class EngineName(StrEnum):
    """Where frames are completed."""

    LOCAL = "local"
    RAY = "ray"


def make_engine(
    name: EngineName,
    *,
    workers: int,
    threads: int | None,
    ray_address: str | None,
    actors: int | None,
) -> "Engine":
    """The engine of the options; InputError for those of the other one."""
    if name is EngineName.LOCAL:
        for option, value in (("ray_address", ray_address), ("actors", actors)):
            if value is not None:
                raise InputError(f"`{option}` is of `engine=ray`")
        from steered_marigold.batch.engines import LocalEngine

        return LocalEngine(workers=workers, threads=threads)
    if workers != 1:
        raise InputError("`workers` is of `engine=local`; a cluster has `actors`")
    from steered_marigold.batch.cluster import RayEngine

    return RayEngine(address=ray_address, actors=actors, threads=threads or 1)


class Count:
    """What became of a run's frames, as it goes on. skipped: None where none can be."""

    def __init__(self, *, skipped: int | None = None, failed: int = 0) -> None:
        self.completed, self.skipped, self.failed = 0, skipped, failed
        self._started = perf_counter()

    def __str__(self) -> str:
        seconds = perf_counter() - self._started
        rate = f", {self.completed / seconds:.2g} frames/s" if self.completed else ""
        skipped = f", {self.skipped} skipped" if self.skipped is not None else ""
        return f"{self.completed} completed{skipped}, {self.failed} failed{rate}"


@contextmanager
def counted(count: Count, *, resumes: bool = True) -> Iterator[None]:
    """Says the count at the end, also where Ctrl-C or SIGTERM is the end (exit codes 130, 143).

    resumes: whether the same command would go on from there.
    """
    rest = "; the same command goes on from here" if resumes else ""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except KeyboardInterrupt:
        say(f"stopped: {count}{rest}")
        raise
    except _Terminated:
        say(f"terminated: {count}{rest}")
        raise typer.Exit(TERMINATED) from None
    finally:
        signal.signal(signal.SIGTERM, before)
    say(count)


class _Terminated(BaseException):
    """SIGTERM came."""


def _terminate(*signalled: object) -> None:
    raise _Terminated
