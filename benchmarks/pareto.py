"""Time and error of what a user could pick instead, on the same frames in the same run.

    python -m benchmarks.pareto FRAMES --frames training/splits/tune.txt --masks REAL_FRAMES

FRAMES holds rgb/ and depth/, one file a frame, paired by name. Methods take turns: each completes
all frames, then each again. An error is the mean over frames, in the area that a protocol is about:
what was not measured, or the whole crop for samples all over it. The front holds the methods than
which none is both faster and better.

librealsense's filters are rewritten in NumPy, pixel for pixel: its own, in C++, take 1 ms where
these take 3 to 50, and 13 to 40 ms where the spatial filter takes 90 to 150. Open3D fills holes of
meshes alone, not of depth images.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import mean
from typing import Annotated

import torch
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.measuring import (
    Force,
    Timing,
    describe,
    idle_machine,
    markdown_table,
    measure_interleaved,
    ratio_cell,
    write_json,
)
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.metrics import depth_errors
from steered_marigold.datasets.dataset import select_frames
from steered_marigold.datasets.registry import open_dataset
from steered_marigold.evaluation.protocols import (
    PreparedFrame,
    Protocol,
    frame_generator,
    prepare,
)
from steered_marigold.io.files import write_figure
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method

SEED = 0
OURS = {"default": "default", "fast": "fast"}
CLASSICAL = (*("nearest", "linear", "ip-basic", "telea", "navier-stokes", "colorization"),)
FILTERS = ("realsense-left", "realsense-farthest", "realsense-nearest", "realsense-spatial")


@dataclass(frozen=True)
class Result:
    """A method's time of a frame, the mean over frames [s], and its errors, means over frames."""

    timing: Timing
    abs_rel: float
    rmse_m: float

    @property
    def point(self) -> tuple[float, float]:
        """(median time, abs_rel): smaller is better in both."""
        return self.timing.median, self.abs_rel


Results = dict[str, Result]


def completers() -> dict[str, DepthCompleter]:
    """Everything that is compared, by the name in tables; ours in the precision users get."""
    methods = {name: create_method(source) for name, source in OURS.items()}
    return methods | {name: create_method(name) for name in (*CLASSICAL, *FILTERS)}


def compare(
    methods: Mapping[str, DepthCompleter], frames: Sequence[PreparedFrame], *, repeats: int
) -> Results:
    """Each method on all frames, once unmeasured and then in turns."""
    errors = {name: mean_errors(method, frames) for name, method in methods.items()}
    works: dict[str, Callable[[], object]] = {
        name: partial(complete_all, method, frames) for name, method in methods.items()
    }
    timings = measure_interleaved(works, warm_up=1, repeats=repeats)
    results = {}
    for name, timing in timings.items():
        seconds = tuple(one / len(frames) for one in timing.seconds)
        results[name] = Result(Timing(seconds, timing.peak_mib), *errors[name])
    return results


def complete_all(method: DepthCompleter, frames: Sequence[PreparedFrame]) -> list[DepthCompletion]:
    """The method's answers."""
    return [
        method.answer(frame.shown, generator=frame_generator(SEED, frame.shown.id, "method"))
        for frame in frames
    ]


def mean_errors(method: DepthCompleter, frames: Sequence[PreparedFrame]) -> tuple[float, float]:
    """(abs_rel, rmse_m) in the area that the protocol is about."""
    errors = [
        depth_errors(answer.depth[0].cpu(), frame.metric_depth, frame.areas[frame.focus])
        for answer, frame in zip(complete_all(method, frames), frames, strict=True)
    ]
    return mean(error.abs_rel for error in errors), mean(error.rmse_m for error in errors)


def front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """The names than which no other is as good in both coordinates and better in one, ascending."""
    names = []
    best = float("inf")
    for name in sorted(points, key=points.__getitem__):
        if points[name][1] < best:
            names.append(name)
            best = points[name][1]
    return names


def table(results: Results) -> str:
    """Every method, fastest first; times faster than `default`."""
    on_front = front({name: result.point for name, result in results.items()})
    header = (
        "method",
        "median s",
        "spread s",
        "memory MiB",
        "times faster",
        "REL",
        "RMSE m",
        "front",
    )
    rows = [
        (
            name,
            *result.timing.cells,
            ratio_cell(result.timing, results["default"].timing),
            f"{result.abs_rel:.4f}",
            f"{result.rmse_m:.3f}",
            "yes" if name in on_front else "",
        )
        for name, result in sorted(results.items(), key=lambda item: item[1].point)
    ]
    return markdown_table(header, rows)


def plot(results: Mapping[str, Results], path: Path) -> None:
    """Error over time, a panel for each protocol."""
    figure = Figure(figsize=(5.5 * len(results), 4.6), layout="constrained")
    panels = figure.subplots(1, len(results), squeeze=False)[0]
    for axes, (protocol, of_protocol) in zip(panels, results.items(), strict=True):
        _plot_panel(axes, of_protocol)
        axes.set_title(protocol)
    write_figure(path, figure, dpi=120)


def _plot_panel(axes: Axes, results: Results) -> None:
    points = {name: result.point for name, result in results.items()}
    line = [points[name] for name in front(points)]
    axes.step(*zip(*line, strict=True), where="post", color="0.6", zorder=0)
    for name, (seconds, error) in points.items():
        color = "tab:red" if name in OURS else "tab:blue"
        timing = results[name].timing.seconds
        axes.plot((min(timing), max(timing)), (error, error), color=color)
        axes.plot(seconds, error, "o", color=color)
        axes.annotate(name, (seconds, error), (4, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("time [s/frame]")
    axes.set_ylabel("REL")
    axes.margins(x=0.2, y=0.1)
    axes.grid(visible=True, which="both", alpha=0.3)


def protocols(masks: Path | None) -> list[Protocol]:
    """Samples all over, a missing centre and, with masks, the holes of real sensors."""
    kinds = [Protocol(kind="paper-uniform"), Protocol(kind="paper-erased")]
    return kinds + ([] if masks is None else [Protocol(kind="sensor", masks=masks)])


def main(
    folder: Annotated[Path, typer.Argument(metavar="FRAMES", help="Folder with rgb/ and depth/.")],
    *,
    frames: Annotated[Path | None, typer.Option(help="File of frame ids, one a line.")] = None,
    limit: Annotated[int | None, typer.Option(help="So many frames, evenly spaced.")] = 12,
    masks: Annotated[
        Path | None, typer.Option(help="Folder of sensors' depth maps, whose holes are taken.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Timed turns of each method.")] = 5,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file and the plot.")] = Path(
        "runs/bench"
    ),
    force: Force = False,
) -> None:
    """Time and error of `default`, `fast` and everything that needs no weights."""
    machine = idle_machine(threads, force=force)
    torch.set_num_threads(threads)
    dataset = open_dataset("folder", folder)
    frame_ids = select_frames(dataset, frames_file=frames, limit=limit)
    methods = completers()
    print(f"{len(frame_ids)} frames of {folder}, {repeats} repeats; {describe(machine)}\n")
    results = {}
    for protocol in protocols(masks):
        prepared = [prepare(dataset.load(i), protocol, seed=SEED) for i in frame_ids]
        results[protocol.kind] = compare(methods, prepared, repeats=repeats)
        print(f"## {protocol.kind}\n\n{table(results[protocol.kind])}\n")
    output.mkdir(parents=True, exist_ok=True)
    plot(results, output / "pareto.png")
    settings = {"frames": frame_ids, "warm_up": 1, "repeats": repeats, "seed": SEED}
    content = {"machine": machine, "settings": settings, "results": results}
    write_json(output / "pareto.json", content)


if __name__ == "__main__":
    typer.run(main)
