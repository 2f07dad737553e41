"""How time and memory of the embedded checkpoint grow with what it is given.

    python -m benchmarks.growth --output runs/bench

Time is that of a call with the model loaded; memory is its peak above the loaded model. Every
preset and sweep has a process of its own, one warm-up call, and goes from small to large. An
exponent is the slope of log(time) or log(memory) over log(what grows): by least squares over the
whole sweep, and between its last two points alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from matplotlib.figure import Figure

from benchmarks.measuring import (
    Force,
    Timing,
    describe,
    idle_machine,
    markdown_table,
    measure,
    write_json,
)
from benchmarks.subjects import embedded_pipeline, sample_frame
from steered_marigold.io.files import write_figure

PRESETS = ("default", "fast")
WIDTH, HEIGHT, POINTS = 640, 480, 13_620
# a call that takes longer [s] than this is not repeated
LONG_S = 8.0
# below this memory is noise [MiB]
LEAST_MIB = 1.0


@dataclass(frozen=True)
class Load:
    """What one call is given. Defaults: a 640x480 frame, as many samples as in the paper.

    ensemble: members; None leaves them to the preset.
    """

    width: int = WIDTH
    height: int = HEIGHT
    points: int = POINTS
    batch: int = 1
    ensemble: int | None = None


@dataclass(frozen=True)
class Point:
    """x: what grows, in the sweep's unit."""

    x: float
    load: Load
    timing: Timing


@dataclass(frozen=True)
class Growth:
    """A finished sweep of a preset."""

    sweep: str
    preset: str
    points: tuple[Point, ...]

    @property
    def seconds(self) -> list[float]:
        """Median of each point."""
        return [point.timing.median for point in self.points]

    @property
    def memory_mib(self) -> list[float]:
        """Peak of each point above the loaded model."""
        return [max(point.timing.peak_mib, LEAST_MIB) for point in self.points]

    def exponents(self) -> dict[str, float]:
        """Of time and memory, over the sweep and at its end."""
        x = [point.x for point in self.points]
        return {
            f"{what}{where}": fitted_exponent(x[part], y[part])
            for what, y in (("time", self.seconds), ("memory", self.memory_mib))
            for where, part in (("", slice(None)), (" at the end", slice(-2, None)))
        }


def sweeps(largest_megapixels: float) -> Mapping[str, Sequence[tuple[float, Load]]]:
    """(what grows, the call's load) of each sweep, ascending. Names are those of the plots."""
    sizes = np.geomspace(WIDTH * HEIGHT / 1e6, largest_megapixels, 5)
    points = (10, 100, 1_000, 10_000, 100_000, 300_000)
    return {
        "image size [megapixels]": [_of_size(float(size)) for size in sizes],
        "measurements": [(n, Load(points=n)) for n in points],
        "ensemble size": [(n, Load(ensemble=n)) for n in (1, 2, 4, 8)],
        "batch size": [(n, Load(batch=n)) for n in (1, 2, 4, 8)],
    }


def _of_size(megapixels: float) -> tuple[float, Load]:
    scale = (megapixels * 1e6 / (WIDTH * HEIGHT)) ** 0.5
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    return width * height / 1e6, Load(width=width, height=height)


def fitted_exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """The e of y = c * x^e, by least squares of the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def run_sweep(
    preset: str, points: Sequence[tuple[float, Load]], repeats: int, threads: int
) -> tuple[Point, ...]:
    """The points of a sweep, in this process."""
    torch.set_num_threads(threads)
    pipeline = embedded_pipeline()
    _call(pipeline, preset, Load())
    measured = []
    for x, load in points:
        timing = _call(pipeline, preset, load)
        if timing.seconds[0] < LONG_S:
            timing = _call(pipeline, preset, load, repeats)
        measured.append(Point(x, load, timing))
    return tuple(measured)


def _call(pipeline: Any, preset: str, load: Load, repeats: int = 1) -> Timing:
    """Times the call; what goes in is made before."""
    frame = sample_frame(load.width, load.height, load.points)
    depth, mask = (m.expand(load.batch, -1, -1) for m in (frame.sparse_depth, frame.mask))
    image = frame.unit_image.expand(load.batch, -1, -1, -1)

    def call() -> object:
        return pipeline(
            image,
            depth,
            mask,
            preset=preset,
            ensemble_size=load.ensemble,
            generator=torch.Generator().manual_seed(0),
        )

    return measure(call, repeats=repeats)


def plot(growths: Sequence[Growth], path: Path) -> None:
    """Time and memory of one sweep on logarithmic axes, a line for each preset."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    time_axes, memory_axes = figure.subplots(1, 2)
    for growth in growths:
        x, exponents = [point.x for point in growth.points], growth.exponents()
        for axes, y, what in (
            (time_axes, growth.seconds, "time"),
            (memory_axes, growth.memory_mib, "memory"),
        ):
            label = f"{growth.preset}: exponent {exponents[what]:.2f}"
            axes.loglog(x, y, marker="o", label=label)
    time_axes.set_ylabel("time [s]")
    memory_axes.set_ylabel("memory above the loaded model [MiB]")
    for axes in (time_axes, memory_axes):
        axes.set_xlabel(growths[0].sweep)
        axes.grid(visible=True, which="both", alpha=0.3)
        axes.legend()
    write_figure(path, figure, dpi=120)


def point_table(growths: Iterable[Growth]) -> str:
    """Every measured point."""
    header = ("grows", "preset", "value", "runs", "median s", "spread s", "memory MiB")
    rows = [
        (g.sweep, g.preset, f"{p.x:g}", len(p.timing.seconds), *p.timing.cells)
        for g in growths
        for p in g.points
    ]
    return markdown_table(header, rows)


def exponent_table(growths: Iterable[Growth]) -> str:
    """The exponents of each sweep."""
    rows = [
        (g.sweep, g.preset, *(f"{exponent:.2f}" for exponent in g.exponents().values()))
        for g in growths
    ]
    header = ("grows", "preset", "time", "time, at the end", "memory", "memory, at the end")
    return markdown_table(header, rows)


def main(
    output: Annotated[Path, typer.Option(help="Folder of the JSON file and the plots.")] = Path(
        "runs/bench"
    ),
    largest: Annotated[float, typer.Option(min=0.5, help="Largest image in megapixels.")] = 8.0,
    repeats: Annotated[
        int, typer.Option(min=1, help="Timed runs of a call under 8 s; a longer one runs once.")
    ] = 5,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    force: Force = False,
) -> None:
    """How time and memory of the embedded checkpoint grow, with the fitted exponents."""
    machine = idle_machine(threads, force=force)
    print(f"{describe(machine)}\n")
    output.mkdir(parents=True, exist_ok=True)
    growths = []
    for number, (sweep, points) in enumerate(sweeps(largest).items(), start=1):
        of_sweep = []
        for preset in PRESETS:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                measured = pool.submit(run_sweep, preset, points, repeats, threads).result()
            of_sweep.append(Growth(sweep, preset, measured))
        plot(of_sweep, output / f"growth-{number}.png")
        growths += of_sweep
    print(point_table(growths))
    print(f"\n{exponent_table(growths)}")
    record = [{**asdict(growth), "exponents": growth.exponents()} for growth in growths]
    write_json(output / "growth.json", {"machine": machine, "growth": record})


if __name__ == "__main__":
    typer.run(main)
