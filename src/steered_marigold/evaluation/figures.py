"""The paper's figures, drawn from a frame of a run."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from steered_marigold.core.geometry import center_crop
from steered_marigold.errors import InputError
from steered_marigold.evaluation.calibration_figure import calibration_figure, kept_curves
from steered_marigold.evaluation.pictures import (
    Answers,
    example_answers,
    sparse_picture,
    truth_picture,
)
from steered_marigold.evaluation.predictions import Predictions
from steered_marigold.evaluation.protocols import PAPER_AREAS, PreparedFrame, frame_generator
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.evaluation.seam_figure import seam_figure
from steered_marigold.evaluation.settings import MethodFactory, RunSettings
from steered_marigold.evaluation.summary import reference_method
from steered_marigold.io.files import write_figure
from steered_marigold.methods.registry import steers
from steered_marigold.pictures.colours import robust_range
from steered_marigold.pictures.grids import panels, show, show_depth

PAPER_TITLES = {"paper-uniform": "all samples", "paper-erased": "centre erased"}


def draw_figures(
    run: Path,
    folder: Path,
    *,
    frame_id: str | None = None,
    create: MethodFactory | None = None,
) -> list[Path]:
    """Writes the figures of one frame (by default the middle one) and returns their paths.

    completion.png: image, input and completion (the paper's Fig. 1). comparison.png: every method,
    under the paper's protocols with all samples and with the centre erased (Fig. 6). areas.png:
    the three areas (Fig. 5), under the paper's protocols. seam.png: depth along a row, where a
    border lies in it. steering.png: the direction of steering in the first and the last step
    (Fig. 4), of the run's first method that steers. calibration.png: of all frames, if a method
    states its uncertainty. Answers are those that the run kept; methods complete the frame once
    more for the others and for the steering, and those that cannot are left out.

    Raises FileFormatError if there is no run, InputError if it has no such frame, or no method can
    complete it.
    """
    settings = RunSettings.load(run)
    frame_id = frame_id or settings.frames[len(settings.frames) // 2]
    if frame_id not in settings.frames:
        raise InputError(f"frame {frame_id!r} is not in the run; its first is {settings.frames[0]}")
    shown = _answers(run, settings, frame_id, create)
    frame, answers = shown[PAPER_TITLES.get(settings.protocol.kind, "")]
    figures: dict[str, Figure | None] = {
        "completion": completion_figure(frame, answers),
        "comparison": comparison_figure(shown),
        "areas": areas_figure(frame) if settings.protocol.from_paper else None,
        "seam": seam_figure(frame, answers),
        "steering": _steering_figure(Evaluator(settings, create), frame, answers),
        "calibration": calibration_figure(kept_curves(run, settings), settings.protocol.focus),
    }
    return [_save(x, folder / f"{name}.png") for name, x in figures.items() if x is not None]


def _answers(
    run: Path, settings: RunSettings, frame_id: str, create: MethodFactory | None
) -> dict[str, tuple[PreparedFrame, Answers]]:
    """The frame and its answers by title: the run's own, and the paper's other protocol."""
    own = settings.protocol.kind
    shown: dict[str, tuple[PreparedFrame, Answers]] = {}
    for kind, title in (PAPER_TITLES if own in PAPER_TITLES else {own: ""}).items():
        protocol = replace(settings.protocol, kind=kind)
        kept = Predictions(settings, run) if kind == own else None
        evaluator = Evaluator(replace(settings, protocol=protocol), create, kept)
        answers = example_answers(evaluator, settings.methods, [frame_id])[frame_id]
        if not answers:
            raise InputError(f"no method of the run could complete frame {frame_id}")
        shown[title] = evaluator.prepare(frame_id), answers
    return shown


def completion_figure(frame: PreparedFrame, answers: Answers) -> Figure:
    """Image, input, and the completion of the reference method."""
    scale = robust_range(truth_picture(frame))
    label = reference_method(answers)
    figure, axes = panels(1, 3, frame.metric_depth.shape)
    show(axes[0, 0], frame.shown.image.numpy(), "image")
    show_depth(axes[0, 1], sparse_picture(frame), scale, "input")
    drawn = show_depth(axes[0, 2], answers[label].numpy(), scale, label)
    figure.colorbar(drawn, ax=axes.ravel().tolist(), label="depth [m]")
    return figure


def comparison_figure(shown: dict[str, tuple[PreparedFrame, Answers]]) -> Figure:
    """Input and every method's answer, a row for each way of measuring the same frame."""
    first, _ = next(iter(shown.values()))
    scale = robust_range(truth_picture(first))
    labels = list(dict.fromkeys(label for _, answers in shown.values() for label in answers))
    figure, axes = panels(len(shown), 1 + len(labels), first.metric_depth.shape)
    for row, (title, (frame, answers)) in zip(axes, shown.items(), strict=True):
        drawn = show_depth(row[0], sparse_picture(frame), scale, title or "input")
        for column, label in zip(row[1:], labels, strict=True):
            column.set_axis_off()
            if label in answers:
                show_depth(column, answers[label].numpy(), scale, label)
    figure.colorbar(drawn, ax=axes.ravel().tolist(), label="depth [m]")
    return figure


def areas_figure(frame: PreparedFrame) -> Figure:
    """The three evaluation areas of the paper on the image."""
    figure, axes = panels(1, 1, frame.metric_depth.shape)
    show(axes[0, 0], frame.shown.image.numpy(), "evaluation areas")
    size = (frame.metric_depth.shape[0], frame.metric_depth.shape[1])
    for (name, area), colour in zip(PAPER_AREAS.items(), ("white", "yellow", "red"), strict=True):
        rows, columns = center_crop(size, area)
        axes[0, 0].add_patch(
            Rectangle(
                (columns.start - 0.5, rows.start - 0.5), area[1], area[0], fill=False, color=colour
            )
        )
        axes[0, 0].text(columns.start + 6, rows.stop - 8, name, color=colour, fontsize=7)
    return figure


def _steering_figure(
    evaluator: Evaluator, frame: PreparedFrame, labels: Iterable[str]
) -> Figure | None:
    """For the first method that steers; None if there is none."""
    for label in labels:
        if steers(label):
            # brings diffusers along, which the other figures do not need
            from steered_marigold.evaluation.steering_figure import record_steering, steering_figure

            completer: Any = evaluator.method(label)
            generator = frame_generator(evaluator.settings.seed, frame.shown.id, "method")
            return steering_figure(frame, record_steering(completer, frame, generator=generator))
    return None


def _save(figure: Figure, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_figure(path, figure, dpi=200)
    return path
