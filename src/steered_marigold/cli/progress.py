"""A bar on a terminal, with the time left; nothing elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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

        def show(done: int, of: int | None, what: str) -> None:
            speed = progress.tasks[bar].speed
            rate = f"{speed:.2g}/s" if speed else ""
            progress.update(bar, completed=done, total=of, description=what, rate=rate)

        yield show
