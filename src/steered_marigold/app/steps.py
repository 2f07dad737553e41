"""The paper's method, step by step, on one frame."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from matplotlib import colormaps
from matplotlib.colors import Normalize

from steered_marigold.app.running import Models, Watch, WatchedCompleter
from steered_marigold.app.views import View, depth_pictures, thumbnail
from steered_marigold.core.frame import Frame
from steered_marigold.frames.complete import complete_frame
from steered_marigold.methods.interpolation import LinearCompleter
from steered_marigold.methods.steering_steps import SteeringStep, StepRecorder, largest_move
from steered_marigold.pictures.colours import robust_range

_PRESET = "paper"
_SHOWN = 8  # pictures of a film strip
_DIRECTION = colormaps["RdBu"].with_extremes(bad=(0.5, 0.5, 0.5))


@dataclass(frozen=True, kw_only=True)
class Method:
    """steered, unsteered: every step of both runs. answers: the depth of each [m], by title."""

    steered: list[SteeringStep]
    unsteered: list[SteeringStep]
    answers: dict[str, torch.Tensor]


def run_method(models: Models, checkpoint: str, frame: Frame, *, seed: int, watch: Watch) -> Method:
    """The paper's run, the same run unsteered, and linear interpolation.

    Raises StoppedError as the watch does, NoMeasurementsError if nothing was measured.
    """
    answers, recorded = {}, []
    for title, knobs, half in (("Steered", {}, 0), ("Not steered", {"steering_strength": 0.0}, 1)):
        completer = models.completer(checkpoint, preset=_PRESET, **knobs)
        recorder = StepRecorder()
        watched = WatchedCompleter(completer, _half(watch, half), recorder)
        completion, _ = complete_frame(watched, frame, seed=seed)
        answers[title] = completion.depth[0]
        recorded.append(recorder.steps)
    linear, _ = complete_frame(LinearCompleter(), frame, seed=seed)
    answers["Linear interpolation"] = linear.depth[0]
    return Method(steered=recorded[0], unsteered=recorded[1], answers=answers)


def method_view(method: Method, frame: Frame) -> View:
    """What the page draws of it."""
    steered, unsteered = method.steered, method.unsteered
    chosen = np.unique(np.linspace(0, len(steered) - 1, _SHOWN).round().astype(int)).tolist()
    scale = robust_range(steered[-1].predicted.numpy())
    early, late = steered[0], steered[-1]
    largest = largest_move((early, late))
    limits = Normalize(-largest, largest)
    return {
        "answers": depth_pictures(frame, method.answers),
        "directions": [
            {
                "title": f"{when} step, t = {step.timestep}",
                "predicted": thumbnail(step.predicted, robust_range(step.target.numpy())),
                "target": thumbnail(step.target, robust_range(step.target.numpy())),
                "difference": thumbnail(step.target - step.predicted, limits, _DIRECTION),
            }
            for when, step in (("Early", early), ("Late", late))
        ],
        "films": [
            {
                "title": title,
                "frames": [
                    {"t": steps[i].timestep, "src": thumbnail(steps[i].predicted, scale)}
                    for i in chosen
                ],
            }
            for title, steps in (("Steered", steered), ("Not steered", unsteered))
        ],
        "steps": len(steered),
    }


def _half(watch: Watch, half: int) -> Watch:
    """The same watch over one of two runs: progress goes on from the first to the second."""

    def on_step(done: int, total: int) -> None:
        watch.on_step(done + half * total, 2 * total)

    return replace(watch, on_step=on_step)
