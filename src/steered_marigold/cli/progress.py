"""A bar on a terminal, with the time left; elsewhere, as in a log, a line a minute."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from steered_marigold.cli.messages import say

_MINUTE_S = 60.0

# (how many are done, of how many or None, what is being done)
Show = Callable[[int, int | None, str], None]


@contextmanager
def progress_bar(doing: str, total: int | None = None) -> Iterator[Show]:
    """Shows on stderr what is called with; speed is per second."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns,
        console=console,
        disable=not console.is_terminal,
        transient=True,
        redirect_stdout=sys.stdout.isatty(),  # records in a pipe must not move to the terminal
    ) as progress:
        bar = progress.add_task(doing, total=total, rate="")
        started = told = perf_counter()

        def show(done: int, of: int | None, what: str) -> None:
            nonlocal told
            now = perf_counter()
            if not console.is_terminal and now - told >= _MINUTE_S:
                told = now
                say(_line(done, of, what, (now - started) / max(done, 1)))
            speed = progress.tasks[bar].speed
            rate = f"{speed:.2g}/s" if speed else ""
            progress.update(bar, completed=done, total=of, description=what, rate=rate)

        yield show


def _line(done: int, of: int | None, what: str, seconds_each: float) -> str:
    """The bar in words."""
    total = "" if of is None else f" of {of}"
    left = "" if of is None else f", {seconds_each * (of - done) / 60:.0f} min left"
    return f"{what}: {done}{total}, {1 / seconds_each:.2g}/s{left}"
