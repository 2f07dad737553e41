"""What users wait for, beside an earlier commit, in turns on one machine.

    python -m benchmarks.since --commit c09536f

Cold: the whole command on the sample frame, in a new process, with its peak memory. Loaded: one
more frame of 640x480 with few and with many measurements, in a process that stays. The earlier
commit is checked out beside, and runs with today's packages and with its own checkpoint.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from benchmarks.measuring import Force, Timing, describe, idle_machine, markdown_table, write_json

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "src" / "steered_marigold" / "assets" / "sample"
POINTS = (13_620, 296_359)
PRESETS = ("fast", "default")
COMMAND = "from steered_marigold.cli import main; main()"
# answers a line with the seconds that one frame took
WORKER = """
import sys, time
import torch
from steered_marigold import SteeredCompleter
preset, points = sys.argv[1], int(sys.argv[2])
generator = torch.Generator().manual_seed(0)
y, x = torch.meshgrid(torch.linspace(0, 1, 480), torch.linspace(0, 1, 640), indexing="ij")
depth = 1.5 + 2 * x + 0.5 * torch.sin(9 * y) + 0.8 * ((x - 0.5).abs() < 0.2)
image = (255 * torch.stack([x, y, depth / 5], dim=-1)).to(torch.uint8)
mask = torch.zeros(480 * 640, dtype=torch.bool)
mask[torch.randperm(480 * 640, generator=generator)[:points]] = True
mask = mask.view(480, 640)
completer = SteeredCompleter.from_checkpoint(preset=preset, device="cpu")
for _ in range(3):
    completer.complete(image, depth * mask, mask)
for line in sys.stdin:
    start = time.perf_counter()
    completer.complete(image, depth * mask, mask)
    print(time.perf_counter() - start, flush=True)
"""


def main(
    commit: Annotated[str, typer.Option(help="What to compare with.")],
    repeats: Annotated[int, typer.Option(min=3, help="Timed runs of each.")] = 5,
    threads: Annotated[int, typer.Option(min=1, help="Of each process.")] = 2,
    output: Annotated[Path, typer.Option(help="Folder for since.json.")] = Path("runs"),
    force: Force = False,
) -> None:
    """Times both in turns; prints a table."""
    record = idle_machine(threads, force=force)
    print(describe(record))
    with earlier_tree(commit) as before:
        trees = {commit: before, "now": ROOT}
        timings = {
            f"complete, cold, {preset}": cold(trees, preset, repeats, threads) for preset in PRESETS
        }
        for preset in PRESETS:
            for points in POINTS:
                timings[f"{preset}, {points} measured"] = loaded(
                    trees, preset, points, repeats, threads
                )
    print(table(timings, commit))
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "since.json", {"machine": record, "commit": commit, "timings": timings})


@contextmanager
def earlier_tree(commit: str) -> Iterator[Path]:
    """A checkout of a commit, removed afterwards."""
    with TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "-q", "--detach", str(tree), commit], check=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def cold(trees: dict[str, Path], preset: str, repeats: int, threads: int) -> dict[str, Timing]:
    """`complete` on the sample frame; once more, unmeasured, for the file cache."""
    runs: dict[str, list[tuple[float, float]]] = {name: [] for name in trees}
    with TemporaryDirectory() as folder:
        files = [SAMPLE / "image.jpg", SAMPLE / "depth.png", "-o", Path(folder) / "o.png"]
        words = [*map(str, files), "--preset", preset]
        for _ in range(repeats + 1):
            for name, tree in trees.items():
                command = [sys.executable, "-c", COMMAND, "complete", *words]
                runs[name].append(_waited(command, _environment(tree, threads)))
    return {
        name: Timing(tuple(seconds for seconds, _ in found[1:]), median(m for _, m in found[1:]))
        for name, found in runs.items()
    }


def _waited(command: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds and peak memory [MiB] of a process."""
    start = time.perf_counter()
    silent = subprocess.DEVNULL
    process = subprocess.Popen(command, env=environment, stdout=silent, stderr=silent)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{command[-4:]} ended with {process.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def loaded(
    trees: dict[str, Path], preset: str, points: int, repeats: int, threads: int
) -> dict[str, Timing]:
    """One frame after another in turns, each tree in a process that has its model loaded."""
    command = [sys.executable, "-c", WORKER, preset, str(points)]
    workers = {
        name: subprocess.Popen(
            command,
            env=_environment(tree, threads),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        for name, tree in trees.items()
    }
    seconds: dict[str, list[float]] = {name: [] for name in workers}
    for _ in range(repeats + 1):  # the first waits for the others to be loaded
        for name, worker in workers.items():
            seconds[name].append(_asked(worker))
    for worker in workers.values():
        worker.communicate()
    return {name: Timing(tuple(found[1:]), float("nan")) for name, found in seconds.items()}


def _asked(worker: "subprocess.Popen[str]") -> float:
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    return float(worker.stdout.readline())


def _environment(tree: Path, threads: int) -> dict[str, str]:
    """The tree's own package, and so many threads."""
    return os.environ | {"PYTHONPATH": str(tree / "src"), "OMP_NUM_THREADS": str(threads)}


def table(timings: dict[str, dict[str, Timing]], commit: str) -> str:
    """Medians with their spread, and how many times faster it is now."""
    rows: list[tuple[Any, ...]] = []
    for work, found in timings.items():
        before, now = found[commit], found["now"]
        faster = now.times_faster(before)
        memory = "" if now.peak_mib != now.peak_mib else f"{before.cells[2]} to {now.cells[2]}"
        rows.append(
            (work, *before.cells[:2], *now.cells[:2], f"{faster:.2f}" if faster else "", memory)
        )
    header = ("", "before s", "spread s", "now s", "spread s", "times faster", "memory MiB")
    return markdown_table(header, rows)


if __name__ == "__main__":
    typer.run(main)
