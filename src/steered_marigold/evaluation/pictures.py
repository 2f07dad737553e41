"""Frames of a run beside the answers to them."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.io.visualization import enlarged, robust_range

Answers = dict[str, Float[Tensor, "height width"]]

_DEPTH = colormaps["turbo"].with_extremes(bad="0.5")
_ERROR = colormaps["magma"].with_extremes(bad="0.5")
_SPARSE, _POINT_RADIUS = 0.1, 2  # below this share, measured pixels are drawn with this radius


def example_answers(
    evaluator: Evaluator, labels: Iterable[str], frame_ids: Sequence[str]
) -> dict[str, Answers]:
    """Answers [m] of methods to a few frames, by frame id and method.

    Kept ones where there are any; a method that fails on a frame is left out there.
    """
    answers: dict[str, Answers] = {frame_id: {} for frame_id in frame_ids}
    for label in labels:
        for frame_id in frame_ids:
            with suppress(Exception):  # the run has counted and reported it
                answers[frame_id][label] = evaluator.depth(label, evaluator.prepare(frame_id))
    return answers


def frame_picture(frame: PreparedFrame, answers: Answers) -> Figure:
    """Image and input, truth, and each answer above its absolute error.

    All depths share one scale, that of the truth, and all errors another; bars in metres.
    """
    truth = truth_picture(frame)
    depths, errors = robust_range(truth), Normalize(0, max(0.1, 0.25 * float(np.nanmedian(truth))))
    figure, axes = panels(2, 2 + len(answers), frame.depth.shape)
    show(axes[0, 0], frame.image.numpy(), "image")
    show_depth(axes[1, 0], sparse_picture(frame), depths, "input")
    drawn = show_depth(axes[0, 1], truth, depths, "truth")
    axes[1, 1].set_visible(False)
    error_drawn = None
    for column, (label, depth) in enumerate(answers.items(), start=2):
        show_depth(axes[0, column], depth.numpy(), depths, label)
        error = np.abs(depth.numpy() - truth)
        error_drawn = show(axes[1, column], error, "error", cmap=_ERROR, norm=errors)
    figure.colorbar(drawn, ax=axes[0].tolist(), label="depth [m]", aspect=12)
    if error_drawn is not None:
        figure.colorbar(error_drawn, ax=axes[1].tolist(), label="absolute error [m]", aspect=12)
    return figure


def panels(rows: int, columns: int, size: Sequence[int]) -> tuple[Figure, NDArray[Any]]:
    """A figure of equal panels for images of `size` (height, width), and its axes."""
    width = 2.6
    figure = Figure(
        figsize=(width * columns + 0.8, (width * size[0] / size[1] + 0.25) * rows),
        dpi=110,
        layout="constrained",
    )
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def show(axes: Axes, picture: NDArray[Any], title: str, **style: Any) -> AxesImage:
    """A picture under its title."""
    axes.set_title(title, fontsize=8)
    axes.set_axis_off()
    return axes.imshow(picture, interpolation="nearest", **style)


def show_depth(axes: Axes, depth: NDArray[Any], scale: Normalize, title: str) -> AxesImage:
    """A depth map in the colours of a scale; what is not known is grey."""
    return show(axes, depth, title, cmap=_DEPTH, norm=scale)


def sparse_picture(frame: PreparedFrame) -> NDArray[np.float32]:
    """The measurements, larger than they are if few; nan elsewhere."""
    mask = frame.measurements.valid_mask.numpy()
    depth = np.where(mask, frame.measurements.sparse_depth.numpy(), np.nan)
    return enlarged(depth, radius=_POINT_RADIUS) if mask.mean() < _SPARSE else depth


def truth_picture(frame: PreparedFrame) -> NDArray[np.float32]:
    """The true depth; nan where it is not known."""
    whole = next(iter(frame.areas.values()))  # the first area of every protocol is the whole frame
    return np.where(whole.numpy(), frame.depth.numpy(), np.nan)
