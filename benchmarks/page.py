"""What a visitor of the page waits for, in Chromium, and what many visitors cost the server.

    python -m benchmarks.page --repeats 5

Each repeat starts the command anew. The page counts as there when it says what to do first; the
result when its numbers are told. Then one server is asked for many completions, first one after the
other, then at once, without a browser.
"""

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.measuring import (
    Force,
    describe,
    idle_machine,
    markdown_table,
    write_json,
)
from benchmarks.waiting import COMMAND

WAITS = ("command to ready", "ready to page", "button to first result", "button to second result")
BROWSER = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
VISITORS = 20  # of those who ask at once
WARM_UP = 20  # requests after which memory is compared


@contextmanager
def served(*options: str) -> Iterator[tuple[str, int]]:
    """The page's address and the process that serves it."""
    with subprocess.Popen([COMMAND, "app", *options], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().removeprefix("ready: ").strip(), process.pid
        finally:
            process.terminate()


def visit(chromium: Any) -> list[float]:
    """Seconds of each of WAITS."""
    begun = time.perf_counter()
    with served() as (url, _):
        seconds = [time.perf_counter() - begun]
        page = chromium.new_page()
        seconds.append(_seconds(lambda: (page.goto(url), page.wait_for_selector(".viewer .empty"))))
        for sample in ("Room", "Office"):
            page.get_by_role("button", name=sample).click()
            page.wait_for_selector(".viewer[data-ready]")
            page.wait_for_selector("#facts li", state="detached")
            seconds.append(_seconds(partial(_complete, page)))
        page.close()
    return seconds


def _complete(page: Any) -> None:
    page.get_by_role("button", name="Complete", exact=True).click()
    page.wait_for_selector("#facts li")


def _seconds(work: Any) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def wait_in_browser(repeats: int) -> dict[str, list[float]]:
    """Seconds of each of WAITS, by name."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium")
    if path is None:
        raise typer.BadParameter("there is no chromium on this machine")
    with sync_playwright() as tools:
        chromium = tools.chromium.launch(executable_path=path, args=list(BROWSER))
        visits = [visit(chromium) for _ in range(repeats)]
        chromium.close()
    return {name: [v[i] for v in visits] for i, name in enumerate(WAITS)}


def many_requests(requests: int) -> dict[str, Any]:
    """Completions in turn and at once, of one server."""
    from benchmarks.page_visitors import at_once, find_handlers, in_turn, resident_mib

    with served("--max-queue", str(requests)) as (url, process_id):
        handlers = find_handlers(url)
        memory = in_turn(url, handlers, process_id, requests=WARM_UP + requests)
        together = at_once(url, handlers, visitors=VISITORS, requests=requests)
        last = resident_mib(process_id)
    return {"memory_mib": memory, "at_once": together, "memory_after_mib": last}


def say_many(found: dict[str, Any], requests: int) -> None:
    """Prints the figures of `many_requests` as a table."""
    memory, together = found["memory_mib"], found["at_once"]
    rows = [
        (f"memory after {WARM_UP} completions", f"{memory[WARM_UP - 1]:.0f} MiB"),
        (f"after {requests} more in turn", f"{memory[-1]:.0f} MiB"),
        (f"after {requests} more at once", f"{found['memory_after_mib']:.0f} MiB"),
        (f"taken of {requests} at once, {VISITORS} visitors", f"{together['taken']}"),
        ("all of them answered after", f"{together['seconds']:.0f} s"),
        ("the page itself meanwhile, at most", f"{together['slowest_page_s']:.2g} s"),
    ]
    print(markdown_table(("requests", "figure"), rows))


def main(
    *,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    repeats: Annotated[int, typer.Option(min=1)] = 5,
    requests: Annotated[int, typer.Option(min=VISITORS, help="In turn, and at once.")] = 200,
    threads: Annotated[int, typer.Option(min=1, help="of the machine, for the record")] = 2,
    force: Force = False,
) -> None:
    """Measures in Debian's Chromium, then without a browser."""
    machine = idle_machine(threads, force=force)
    waits = wait_in_browser(repeats)
    rows = []
    for name, seconds in waits.items():
        ordered = sorted(seconds)
        spread = f"{ordered[0]:.3g} to {ordered[-1]:.3g}"
        rows.append((name, f"{ordered[len(ordered) // 2]:.3g}", spread))
    print(describe(machine))
    print(markdown_table(("wait", "median s", "spread s"), rows), flush=True)
    found = many_requests(requests)
    say_many(found, requests)
    write_json(output / "page.json", {"machine": machine, "seconds": waits, "requests": found})


if __name__ == "__main__":
    typer.run(main)
