"""What a user of the embedded checkpoint waits for: the command's start, and a 640x480 frame.

    python -m benchmarks.waiting --frame FOLDER

Every measurement has a process of its own. This process loads no torch: a child's peak memory, as
Linux counts it, is never below that of the process which started it.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.measuring import (
    Force,
    Timing,
    describe,
    idle_machine,
    markdown_table,
    measure,
    peak_mib,
    write_json,
)

COMMAND = Path(sys.executable).with_name("steered-marigold")
PRESETS = ("default", "fast")
PAPER_POINTS = 13_620


def time_command(arguments: Sequence[str], *, repeats: int, threads: int) -> Timing:
    """The command from start to exit, imports and loading included; no warm-up.

    peak_mib: its whole resident set. Raises RuntimeError if the command fails.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    seconds, peaks = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        with tempfile.TemporaryFile() as output:
            process = subprocess.Popen(
                [COMMAND, *arguments], stdout=output, stderr=output, env=environment
            )
            _, status, usage = os.wait4(process.pid, 0)
            seconds.append(time.perf_counter() - start)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                output.seek(0)
                raise RuntimeError(f"{COMMAND.name} failed: {output.read().decode()}")
        peaks.append(usage.ru_maxrss / 1024)
    return Timing(tuple(seconds), max(peaks))


def time_commands(repeats: int, threads: int) -> dict[str, Timing]:
    """The help, and the first completion of the packaged sample."""
    import importlib.resources

    sample = importlib.resources.files("steered_marigold") / "assets" / "sample"
    with tempfile.TemporaryDirectory() as folder:
        files = [str(sample / "image.jpg"), str(sample / "depth.png")]
        complete = ["complete", *files, "--output", str(Path(folder) / "dense.png")]
        works = {"--help": ["--help"], "complete SAMPLE": complete}
        return {
            name: time_command(arguments, repeats=repeats, threads=threads)
            for name, arguments in works.items()
        }


def time_frame(preset: str, folder: Path | None, repeats: int, threads: int) -> dict[str, Any]:
    """A 640x480 frame with the model loaded, one warm-up call; in a process of its own.

    folder: the sensor's frame, None for the packaged sample with 13 620 measurements.
    """
    import torch

    from benchmarks.subjects import embedded_pipeline, read_frame, sample_frame

    torch.set_num_threads(threads)
    frame = sample_frame(640, 480, PAPER_POINTS) if folder is None else read_frame(folder)
    pipeline = embedded_pipeline()

    def call() -> object:
        generator = torch.Generator().manual_seed(0)
        return pipeline(
            frame.unit_image, frame.sparse_depth, frame.mask, preset=preset, generator=generator
        )

    call()
    timing = measure(call, repeats=repeats)
    height, width = frame.mask.shape
    return {
        "preset": preset,
        "frame": "sample" if folder is None else folder.name,
        "size": f"{width}x{height}",
        "measurements": int(frame.mask.sum()),
        # the whole process since its first timed call began, libraries and model included
        "timing": Timing(timing.seconds, peak_mib()),
    }


def time_frames(folder: Path, repeats: int, threads: int) -> list[dict[str, Any]]:
    """Both presets on the sensor's frame, if it is here, and on the sample."""
    rows = []
    folders = [*present(folder), None]
    for preset in PRESETS:
        for one in folders:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                rows.append(pool.submit(time_frame, preset, one, repeats, threads).result())
    return rows


def present(folder: Path) -> list[Path]:
    """The folder, or nothing and a message."""
    if folder.is_dir():
        return [folder]
    print(f"{folder} is not on this machine: its rows are left out (--frame FOLDER)\n")
    return []


def command_table(commands: Mapping[str, Timing]) -> str:
    """The first run, which may find cold file caches, and all runs."""
    header = ("steered-marigold", "first run s", "median s", "spread s", "peak memory MiB")
    rows = [(name, f"{t.seconds[0]:.3g}", *t.cells) for name, t in commands.items()]
    return markdown_table(header, rows)


def frame_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Frames with the model loaded."""
    keys = ("preset", "frame", "size", "measurements")
    header = (*keys, "median s", "spread s", "peak memory MiB")
    return markdown_table(header, [(*(r[key] for key in keys), *r["timing"].cells) for r in rows])


def main(
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    frame: Annotated[
        Path, typer.Option(help="Folder of a sensor's frame: rgb.* and depth.png.")
    ] = Path("../shared/data/real_frames/realsense_2"),
    repeats: Annotated[int, typer.Option(min=1, help="Timed runs of each.")] = 5,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    force: Force = False,
) -> None:
    """Cold start of the command, and 640x480 frames with the embedded checkpoint loaded."""
    machine = idle_machine(threads, force=force)
    print(f"{describe(machine)}\n")
    commands = time_commands(repeats, threads)
    print(f"{command_table(commands)}\n")
    frames = time_frames(frame, repeats, threads)
    print(frame_table(frames))
    record = {"machine": machine, "commands": commands, "frames": frames}
    write_json(output / "waiting.json", record)


if __name__ == "__main__":
    typer.run(main)
