"""The consistency solve and the second pass's depth, each against an earlier commit's.

    python -m benchmarks.solve --since 0b07e0c

The earlier code comes from git; both run in turns in one process, on the sample frame with a prior
that is wrong by a smooth factor.
"""

import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import torch
import typer

from benchmarks.measuring import Timing, machine, markdown_table, measure_interleaved, write_json
from benchmarks.subjects import PAPER_FRACTION, BenchmarkFrame, sample_frame
from steered_marigold.core import consistency, continuation
from steered_marigold.core.consistency import SensorNoise

BEFORE, NOW = "before", "now"
DENSE = 0.95


def main(
    *,
    since: Annotated[str, typer.Option(help="Commit to compare with.")] = "0b07e0c",
    sizes: Annotated[str, typer.Option(help="Width x height, several by comma.")] = "640x480",
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    repeats: Annotated[int, typer.Option(min=1)] = 15,
    threads: Annotated[int, typer.Option(min=1)] = 2,
) -> None:
    """Times both on frames with 5 % and 95 % of the pixels measured; prints a table."""
    torch.set_num_threads(threads)
    solves = {BEFORE: earlier(since, "consistency"), NOW: consistency}
    told = {BEFORE: earlier(since, "continuation"), NOW: continuation}
    timings: dict[str, dict[str, Timing]] = {}
    for size in sizes.split(","):
        width, height = map(int, size.split("x"))
        for share in (PAPER_FRACTION, DENSE):
            frame = sample_frame(width, height, round(share * width * height))
            for stage, modules, work in (("solve", solves, _solve), ("told", told, _told)):
                works = {name: work(module, frame) for name, module in modules.items()}
                timing = measure_interleaved(works, warm_up=2, repeats=repeats)
                timings[f"{stage}, {size}, {share:.0%} measured"] = timing
    print(table(timings))
    record = {"machine": machine(), "since": since, "timings": timings}
    write_json(output / "solve.json", record)


def earlier(commit: str, name: str) -> ModuleType:
    """A module of `core` as it was at a commit; what it imports is today's."""
    path = f"src/steered_marigold/core/{name}.py"
    root = Path(__file__).resolve().parents[1]
    source = subprocess.run(
        ["git", "show", f"{commit}:{path}"], cwd=root, check=True, capture_output=True, text=True
    ).stdout
    module = ModuleType(f"earlier_{name}")
    exec(compile(source, path, "exec"), module.__dict__)
    return module


def table(timings: dict[str, dict[str, Timing]]) -> str:
    """Each stage before and now."""
    header = ("stage", "", "median s", "spread s", "memory MiB", "times faster")
    rows = [
        (stage, name, *timing.cells, f"{both[BEFORE].median / timing.median:.3g}")
        for stage, both in timings.items()
        for name, timing in both.items()
    ]
    return markdown_table(header, rows)


def _bent(frame: BenchmarkFrame) -> torch.Tensor:
    return frame.sparse_depth * torch.linspace(0.9, 1.1, frame.sparse_depth.shape[1])


def _solve(module: Any, frame: BenchmarkFrame) -> Callable[[], object]:
    prior, image = _bent(frame), frame.unit_image
    noise = module.SensorNoise() if module is not consistency else SensorNoise()

    def work() -> object:
        return module.agree_with_measurements(
            prior, frame.sparse_depth, frame.mask, noise=noise, image=image
        )

    return work


def _told(module: Any, frame: BenchmarkFrame) -> Callable[[], object]:
    prior = _bent(frame)
    predicted = 2 * prior / prior.max() - 1

    def work() -> object:
        _, trusted = module.told_depth(predicted, frame.sparse_depth, frame.mask)
        return module.known_cells(trusted, 8)

    return work


if __name__ == "__main__":
    typer.run(main)
