"""Frames of a run beside the answers to them."""

from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
from jaxtyping import Float
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.pictures import colours
from steered_marigold.pictures.colours import ERROR, robust_range
from steered_marigold.pictures.grids import panels, show, show_depth

Answers = dict[str, Float[Tensor, "height width"]]

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
    figure, axes = panels(2, 2 + len(answers), frame.metric_depth.shape)
    show(axes[0, 0], frame.shown.image.numpy(), "image")
    show_depth(axes[1, 0], sparse_picture(frame), depths, "input")
    drawn = show_depth(axes[0, 1], truth, depths, "truth")
    axes[1, 1].set_visible(False)
    error_drawn = None
    for column, (label, depth) in enumerate(answers.items(), start=2):
        show_depth(axes[0, column], depth.numpy(), depths, label)
        error = np.abs(depth.numpy() - truth)
        error_drawn = show(axes[1, column], error, "error", cmap=ERROR, norm=errors)
    figure.colorbar(drawn, ax=axes[0].tolist(), label="depth [m]", aspect=12)
    if error_drawn is not None:
        figure.colorbar(error_drawn, ax=axes[1].tolist(), label="absolute error [m]", aspect=12)
    return figure


def sparse_picture(frame: PreparedFrame) -> NDArray[np.float32]:
    """The measurements, larger than they are if few; nan elsewhere."""
    measured = frame.shown
    depth, mask = measured.sparse_depth.numpy(), measured.valid_mask.numpy()
    return colours.sparse_picture(depth, mask, below=_SPARSE, radius=_POINT_RADIUS)


def truth_picture(frame: PreparedFrame) -> NDArray[np.float32]:
    """The true depth; nan where it is not known."""
    whole = next(iter(frame.areas.values()))  # the first area of every protocol is the whole frame
    return np.where(whole.numpy(), frame.metric_depth.numpy(), np.nan)
