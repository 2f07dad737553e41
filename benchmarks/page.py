"""What a visitor of the page waits for, in Chromium: the page itself, and the first result.

    python -m benchmarks.page --repeats 5

Each repeat starts the command anew. The page counts as there when it says what to do first; the
result when its numbers are told.
"""

import shutil
import subprocess
import time
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


def visit(chromium: Any) -> list[float]:
    """Seconds of each of WAITS."""
    begun = time.perf_counter()
    with subprocess.Popen([COMMAND, "app"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("ready: ").strip()
        seconds = [time.perf_counter() - begun]
        page = chromium.new_page()
        seconds.append(_seconds(lambda: (page.goto(url), page.wait_for_selector(".viewer .empty"))))
        for sample in ("Room", "Office"):
            page.get_by_role("button", name=sample).click()
            page.wait_for_selector(".viewer[data-ready]")
            page.wait_for_selector("#facts li", state="detached")
            seconds.append(_seconds(partial(_complete, page)))
        page.close()
        process.terminate()
    return seconds


def _complete(page: Any) -> None:
    page.get_by_role("button", name="Complete", exact=True).click()
    page.wait_for_selector("#facts li")


def _seconds(work: Any) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def main(
    *,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    repeats: Annotated[int, typer.Option(min=1)] = 5,
    threads: Annotated[int, typer.Option(min=1, help="of the machine, for the record")] = 2,
    force: Force = False,
) -> None:
    """Measures in Debian's Chromium."""
    from playwright.sync_api import sync_playwright

    machine = idle_machine(threads, force=force)
    path = shutil.which("chromium")
    if path is None:
        raise typer.BadParameter("there is no chromium on this machine")
    with sync_playwright() as tools:
        chromium = tools.chromium.launch(executable_path=path, args=list(BROWSER))
        visits = [visit(chromium) for _ in range(repeats)]
        chromium.close()
    waits = {name: [v[i] for v in visits] for i, name in enumerate(WAITS)}
    rows = []
    for name, seconds in waits.items():
        ordered = sorted(seconds)
        spread = f"{ordered[0]:.3g} to {ordered[-1]:.3g}"
        rows.append((name, f"{ordered[len(ordered) // 2]:.3g}", spread))
    print(describe(machine))
    print(markdown_table(("wait", "median s", "spread s"), rows))
    write_json(output / "page.json", {"machine": machine, "seconds": waits})


if __name__ == "__main__":
    typer.run(main)
