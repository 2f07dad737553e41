"""Runs the parts of an evaluation."""

from collections.abc import Callable, Sequence
from time import perf_counter

import torch

from steered_marigold.errors import InputError
from steered_marigold.io.files import create_folder
from training.evaluation.calibration import calibration
from training.evaluation.coding import coding
from training.evaluation.comparison import steering, steps
from training.evaluation.denoising import denoising
from training.evaluation.kinds import kinds
from training.evaluation.report import add_part, check_same_weights, read_figures
from training.evaluation.sheet import sheet
from training.evaluation.speed import speed
from training.evaluation.subject import SEED, Findings, Subject

PARTS: dict[str, Callable[[Subject], Findings]] = {
    "denoiser": denoising,
    "calibration": calibration,
    "steps": steps,
    "steering": steering,
    "codec": coding,
    "speed": speed,
    "sheet": sheet,
    "kinds": kinds,
}


def evaluate(subject: Subject, parts: Sequence[str]) -> None:
    """Measures each part and adds it to the figures in the output folder as soon as it is done.

    Raises InputError for an unknown part, or if the folder holds figures of other weights.
    """
    unknown = set(parts) - set(PARTS)
    if unknown:
        raise InputError(f"no part is called {sorted(unknown)[0]!r}: choose of {', '.join(PARTS)}")
    create_folder(subject.output)
    identity = {"checkpoint": subject.checkpoint, "weights": subject.weights()}
    check_same_weights(read_figures(subject.output), identity, subject.output)
    conditions = {
        "split": subject.split,
        "frames": len(subject.frames),
        "seed": SEED,
        "threads": torch.get_num_threads(),
    }
    for name in parts:
        started = perf_counter()
        found = PARTS[name](subject)
        minutes = round((perf_counter() - started) / 60, 2)
        add_part(subject.output, identity, name, {**conditions, "minutes": minutes}, found)
        print(f"{name}: {minutes} min", flush=True)
