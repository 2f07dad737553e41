"""What streaming saves and steadies: a rendered camera path, frame by frame and as a stream.

    python -m benchmarks.streaming --frames 30

No real video comes with this project, so a hand-held camera moves through procedural rooms
(`rooms`), and a depth camera's holes are simulated. The checkpoint was trained on other
rooms of this generator: errors here are lower than on real frames, and only the comparison counts.
"""

from collections.abc import Callable
from pathlib import Path
from statistics import mean, median
from time import perf_counter
from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from benchmarks.measuring import Force, describe, idle_machine, markdown_table, write_json
from rooms.render import RoomFrame, camera_path
from rooms.sensor import sensor_holes
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.streaming import StreamingCompleter

# far from the seeds of the training data
FIRST_SEED = 900_000
Complete = Callable[[Tensor, Tensor, Tensor], DepthCompletion]


def completers(steps: int) -> dict[str, Callable[[], Complete]]:
    """What is compared, by name; each call starts a new video."""
    alone = SteeredCompleter.from_checkpoint(preset="fast", device="cpu")
    twice = SteeredCompleter.from_checkpoint(preset="fast", device="cpu", num_inference_steps=steps)

    def frame_by_frame(completer: SteeredCompleter) -> Complete:
        generator = torch.Generator().manual_seed(0)
        return lambda *frame: completer.complete(*frame, generator=generator)

    return {
        "fast, 1 step": lambda: frame_by_frame(alone),
        f"fast, {steps} steps": lambda: frame_by_frame(twice),
        "stream": lambda: StreamingCompleter(twice).complete,
    }


def run_path(
    complete: Complete, frames: list[RoomFrame], masks: list[Tensor]
) -> tuple[list[float], list[Tensor]]:
    """Seconds and relative error (signed) of every frame."""
    seconds, errors = [], []
    for frame, mask in zip(frames, masks, strict=True):
        image, truth = torch.from_numpy(frame.image), torch.from_numpy(frame.depth)
        start = perf_counter()
        answer = complete(image, torch.where(mask, truth, 0.0), mask)
        seconds.append(perf_counter() - start)
        errors.append(answer.depth[0] / truth - 1)
    return seconds, errors


def flicker(errors: list[Tensor], masks: list[Tensor]) -> float:
    """Mean change of the relative error from frame to frame where neither frame was measured.

    A still answer of a still scene has 0, whatever its error. The camera moves by a pixel or two
    between frames, which adds the same to every method.
    """
    changes = []
    for i in range(1, len(errors)):
        hidden = ~(masks[i] | masks[i - 1])
        changes.append(float((errors[i] - errors[i - 1])[hidden].abs().mean()))
    return mean(changes)


def main(
    frames: Annotated[int, typer.Option(help="Frames of each path, 1/30 s apart.")] = 30,
    paths: Annotated[int, typer.Option(help="Rooms.")] = 4,
    steps: Annotated[int, typer.Option(help="Denoising steps of the first frame.")] = 2,
    threads: Annotated[int, typer.Option()] = 2,
    output: Annotated[Path, typer.Option(help="Folder of the JSON file.")] = Path("runs/bench"),
    force: Force = False,
) -> None:
    """Time, error and flicker in the holes, of each way through the same frames."""
    machine = idle_machine(threads, force=force)
    print(f"{describe(machine)}\n")
    torch.set_num_threads(threads)
    methods = completers(steps)
    figures: dict[str, list[tuple[float, float, float]]] = {name: [] for name in methods}
    for seed in range(FIRST_SEED, FIRST_SEED + paths):
        path = list(camera_path(seed, frames))
        masks = [
            torch.from_numpy(sensor_holes(frame, np.random.default_rng(seed))) for frame in path
        ]
        for name, start in methods.items():
            seconds, errors = run_path(start(), path, masks)
            hidden = zip(errors, masks, strict=True)
            abs_rel = mean(float(error[~mask].abs().mean()) for error, mask in hidden)
            figures[name].append((median(seconds[1:]), abs_rel, flicker(errors, masks)))
    rows = {name: [mean(column) for column in zip(*f, strict=True)] for name, f in figures.items()}
    print(f"{paths} paths of {frames} frames, 320x240; errors where nothing was measured\n")
    header = ("method", "s / frame", "abs_rel", "flicker")
    cells = [(name, f"{s:.3f}", f"{e:.4f}", f"{c:.4f}") for name, (s, e, c) in rows.items()]
    print(markdown_table(header, cells))
    write_json(output / "streaming.json", {"machine": machine, "rows": rows})


if __name__ == "__main__":
    typer.run(main)
