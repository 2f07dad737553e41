"""Frames a second of folder runs with several numbers of workers.

    python -m benchmarks.throughput IMAGES DEPTHS --workers 1 --workers 2

Whole commands, imports and loading included, each into a new folder, with one thread a worker; all
must give the same bytes.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.measuring import Force, describe, idle_machine, markdown_table, write_json
from benchmarks.waiting import COMMAND


def run(images: Path, depths: Path, out: Path, *, workers: int, preset: str) -> float:
    """Seconds of a command."""
    how = ["--preset", preset, "--workers", str(workers), "--threads", "1", "--device", "cpu"]
    command = [str(COMMAND), "complete", str(images), str(depths), "-o", str(out), *how]
    started = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - started


def require_equal(one: Path, other: Path) -> int:
    """How many results there are; exits if they differ."""
    results = sorted(one.glob("*.png"))
    for path in results:
        if path.read_bytes() != (other / path.name).read_bytes():
            sys.exit(f"{path.name} differs between {one} and {other}")
    return len(results)


def main(
    images: Path,
    depths: Path,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    workers: Annotated[list[int], typer.Option(help="Repeatable; the first is compared with.")] = [  # noqa: B006
        1,
        2,
    ],
    preset: str = "default",
    force: Force = False,
) -> None:
    """Prints a table, and writes throughput.json."""
    machine = idle_machine(1, force=force)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        folders = {number: Path(folder) / str(number) for number in workers}
        for number, out in folders.items():
            seconds = run(images, depths, out, workers=number, preset=preset)
            frames = require_equal(folders[workers[0]], out)
            rows.append({"workers": number, "frames": frames, "seconds": seconds})
    print(f"{describe(machine)}\n")
    table = [
        [x["workers"], x["frames"], f"{x['seconds']:.1f}", f"{x['frames'] / x['seconds']:.2f}"]
        for x in rows
    ]
    print(markdown_table(["workers", "frames", "s", "frames / s"], table))
    write_json(output / "throughput.json", {"machine": machine, "preset": preset, "runs": rows})


if __name__ == "__main__":
    typer.run(main)
