"""The direction of steering in an early and a late step (the paper's Fig. 4)."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from torch import Generator

from steered_marigold.evaluation.pictures import sparse_picture, truth_picture
from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.steering_steps import SteeringStep, StepRecorder, largest_move
from steered_marigold.pictures.colours import robust_range
from steered_marigold.pictures.grids import panels, show, show_depth


def record_steering(
    completer: SteeredCompleter, frame: PreparedFrame, *, generator: Generator
) -> list[SteeringStep]:
    """The steps of one completion; none if the completer does not steer."""
    if not completer.steers:
        return []
    recorder = StepRecorder()
    completer.run(
        frame.shown,
        generator,
        callback_on_step_end=recorder,
        callback_on_step_end_tensor_inputs=recorder.tensor_inputs,
    )
    return recorder.steps


def steering_figure(frame: PreparedFrame, steps: Sequence[SteeringStep]) -> Figure:
    """Truth and samples; then x0D, the map it is moved to, and their difference, a row a step.

    The two steps drawn are the first and the last. Strength is not taken into account.
    """
    truth = truth_picture(frame)
    figure, axes = panels(2, 4, frame.metric_depth.shape)
    show_depth(axes[0, 0], truth, robust_range(truth), "truth")
    show_depth(axes[1, 0], sparse_picture(frame), robust_range(truth), "samples")
    shown = (steps[0], steps[-1])
    largest = largest_move(shown)
    for row, step in zip(axes, shown, strict=True):
        scale = robust_range(step.target.numpy())
        show_depth(row[1], step.predicted.numpy(), scale, f"t = {step.timestep}: predicted")
        show_depth(row[2], step.target.numpy(), scale, "steered towards")
        direction = (step.target - step.predicted).numpy()
        limits = {"vmin": -largest, "vmax": largest}
        drawn = show(row[3], direction, "difference", cmap="RdBu", **limits)
    figure.colorbar(drawn, ax=axes.ravel().tolist(), label="affine depth, of -1 to 1")
    return figure
