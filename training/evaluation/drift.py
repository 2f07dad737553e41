"""How the condition's scale and shift move while steering refits them, or does not."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch import Tensor

from steered_marigold.core.alignment import fit_scale_shift
from steered_marigold.core.steering import normalise_condition
from steered_marigold.diffusion.grid import Measured
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.diffusion.settings import PAPER
from steered_marigold.evaluation.protocols import PreparedFrame, frame_generator
from steered_marigold.evaluation.steering_figure import record_steering
from steered_marigold.io.files import write_figure
from steered_marigold.methods.registry import create_method
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.steering_steps import SteeringStep
from training.data import depth_range
from training.evaluation.subject import SEED, Row, Subject, evenly_spaced

ALIGNMENTS = ("least_squares", "minmax")
FRAMES = 3
PICTURE = "drift.png"


@dataclass(frozen=True)
class Course:
    """Least-squares maps of a frame's condition to x0D, step by step, and to the truth.

    timesteps: [steps]. fits: scale and shift [steps, 2], in units of [-1, 1]. truth: those to the
    true depth, normalised as in training.
    """

    frame_id: str
    alignment: str
    timesteps: list[int]
    fits: list[tuple[float, float]]
    truth: tuple[float, float]


def draw_drift(subject: Subject, methods: Mapping[str, str]) -> tuple[list[Row], str]:
    """Rows of the last step, and the picture's name. methods: alignments by method name."""
    courses = []
    for label, alignment in methods.items():
        completer = cast(SteeredCompleter, create_method(label, checkpoint=subject.checkpoint))
        for frame_id in evenly_spaced(subject.frames, FRAMES):
            frame = subject.prepared("paper-erased", frame_id)
            generator = frame_generator(SEED, frame_id, "method")
            steps = record_steering(completer, frame, generator=generator)
            courses.append(_course(completer.pipeline, frame, alignment, steps))
    write_figure(subject.output / PICTURE, _figure(courses))
    rows = [
        {
            "frame": course.frame_id,
            "condition_alignment": course.alignment,
            "scale": course.fits[-1][0],
            "shift": course.fits[-1][1],
            "true_scale": course.truth[0],
            "true_shift": course.truth[1],
        }
        for course in courses
    ]
    return rows, PICTURE


def _course(
    pipeline: SteeredMarigold,
    frame: PreparedFrame,
    alignment: str,
    steps: list[SteeringStep],
) -> Course:
    depth, known = _measured_on_grid(pipeline, frame)
    condition = normalise_condition(depth, known)
    low, high = depth_range(frame.metric_depth.numpy())
    truth = 2 * (depth - low) / (high - low) - 1
    return Course(
        frame.shown.id,
        alignment,
        [step.timestep for step in steps],
        [scale_and_shift(condition, step.predicted[None], known) for step in steps],
        scale_and_shift(condition, truth, known),
    )


def _measured_on_grid(pipeline: SteeredMarigold, frame: PreparedFrame) -> tuple[Tensor, Tensor]:
    """Measurements [m] and their mask, [1, h, w], where preset `paper` steers."""
    shown = frame.shown
    images = pipeline.load_images(shown.image.permute(2, 0, 1).float() / 255)
    views = pipeline.view(images, PAPER.sampling)
    on_grid = views.on_grid(Measured(shown.sparse_depth[None], shown.valid_mask[None]))
    return on_grid.sparse_depth, on_grid.valid_mask


def scale_and_shift(source: Tensor, target: Tensor, mask: Tensor) -> tuple[float, float]:
    """The least-squares map from source to target [1, height, width] over the mask."""
    fit = fit_scale_shift(source, target, mask)
    return float(fit.scale), float(fit.shift)


def _figure(courses: list[Course]) -> Figure:
    """Scale above shift over the steps: a colour a frame, a line style an alignment."""
    figure = Figure(figsize=(8, 7), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 1, sharex=True)
    frames = list(dict.fromkeys(course.frame_id for course in courses))
    colours = {frame: f"C{number}" for number, frame in enumerate(frames)}
    styles = dict(zip(ALIGNMENTS, ("-", "--"), strict=True))
    for course in courses:
        colour, label = colours[course.frame_id], f"{course.frame_id}, {course.alignment}"
        for i, name in enumerate(("scale", "shift")):
            values = [fit[i] for fit in course.fits]
            axes[i].plot(
                course.timesteps, values, styles[course.alignment], color=colour, label=label
            )
            axes[i].axhline(course.truth[i], color=colour, linestyle=":", linewidth=0.8)
            axes[i].set_ylabel(f"{name} of the condition to x0")
    axes[0].legend(fontsize=7)
    axes[1].set_xlabel("timestep (dotted: the fit to the truth)")
    axes[1].invert_xaxis()
    return figure
