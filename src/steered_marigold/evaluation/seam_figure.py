"""Depth along a row of the image, across the border of the known area."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from steered_marigold.evaluation.pictures import Answers, truth_picture
from steered_marigold.evaluation.protocols import PreparedFrame

_AROUND_PX = 25


def seam_figure(frame: PreparedFrame, answers: Answers) -> Figure | None:
    """Truth and answers along the middle one of the rows with a border, and closer at the border.

    The border drawn closer is that of the row's hole with the most truth. Grey is what is not
    known. None if the protocol has no border, or no row has one.
    """
    if frame.known_area is None:
        return None
    hidden, truth = ~frame.known_area.numpy(), truth_picture(frame)
    scored = hidden & np.isfinite(truth)
    rows = np.flatnonzero(scored.any(axis=1) & ~hidden.all(axis=1))
    if not rows.size:
        return None
    row = int(rows[len(rows) // 2])
    holes = _holes(hidden[row])
    first, end = max(holes, key=lambda hole: int(scored[row, slice(*hole)].sum()))
    lines = {label: depth.numpy()[row] for label, depth in answers.items()}
    figure = Figure(figsize=(10, 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    whole, near = figure.subplots(1, 2)
    for axes, title in ((whole, f"row {row}"), (near, f"row {row}, at the border")):
        _draw(axes, truth[row], lines, holes)
        axes.set(title=title, xlabel="column [px]", ylabel="depth [m]")
    border = first or end
    columns = slice(max(0, border - _AROUND_PX), border + _AROUND_PX)
    near.set_xlim(columns.start, columns.stop - 1)
    near.set_ylim(*_limits([line[columns] for line in (truth[row], *lines.values())]))
    whole.legend(fontsize=7)
    return figure


def _draw(
    axes: Axes,
    truth: NDArray[np.float32],
    lines: Mapping[str, NDArray[np.float32]],
    holes: Sequence[tuple[int, int]],
) -> None:
    """Depth [m] by column; the truth with dots, for where its neighbours are not known."""
    axes.plot(truth, color="black", linewidth=2.2, marker=".", markersize=3, label="truth")
    for label, depth in lines.items():
        axes.plot(depth, linewidth=1, label=label)
    for first, end in holes:
        axes.axvspan(first - 0.5, end - 0.5, color="0.92")


def _holes(hidden: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and end of each run of True."""
    steps = np.diff(np.concatenate(([0], hidden.astype(np.int8), [0])))
    starts, ends = (np.flatnonzero(steps == step).tolist() for step in (1, -1))
    return list(zip(starts, ends, strict=True))


def _limits(lines: Sequence[NDArray[np.float32]]) -> tuple[float, float]:
    """Least and largest known depth [m], with a margin."""
    values = np.concatenate(lines)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = max(0.05 * (high - low), 0.01)
    return low - margin, high + margin
