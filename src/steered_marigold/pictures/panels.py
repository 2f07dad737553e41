"""A picture of what went in and what came out, for people."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.pictures.colours import (
    DEPTH,
    ERROR,
    robust_range,
    sparse_picture,
    uncertainty_range,
)

_PANEL_INCHES, _GAP, _ABOVE, _BELOW = 4.8, 0.35, 0.35, 0.8
_LONGEST_SIDE = 1280  # pixels of a panel; larger frames are drawn at every other pixel, or less
_LEAST_WIDTH = 480  # pixels of a panel, so that its labels can be read
_SPARSE = 0.05  # below this share of measured pixels, single pixels are hard to see


def frame_panels(
    frame: Frame,
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"] | None = None,
    *,
    metric: bool = True,
) -> Figure:
    """Image, input, result and (if given) uncertainty, side by side.

    Depths [m], 0 in `depth` = unknown, share one colour scale: the 1st to 99th percentile of the
    result. What is missing is grey. Sparse measurements are drawn larger than they are. Without
    `metric` the result is relative, in [0, 1].
    """
    measured = frame.valid_mask.cpu().numpy()
    panels = _map_panels(
        f"input, {measured.mean():.1%} measured",
        frame.sparse_depth.cpu().numpy(),
        measured,
        depth,
        uncertainty,
        metric=metric,
    )
    return _side_by_side([_Panel("image", frame.image.cpu().numpy()), *panels])


def completion_panels(completion: DepthCompletion) -> Figure:
    """Believed measurements, result and (if there) uncertainty of the first image, alike."""
    believed, sigma = completion.trusted[0].cpu().numpy(), completion.uncertainty
    panels = _map_panels(
        f"believed measurements, {believed.mean():.1%}",
        completion.depth[0].cpu().numpy(),
        believed,
        completion.depth[0],
        None if sigma is None else sigma[0],
        metric=completion.metric,
    )
    return _side_by_side(panels)


@dataclass(frozen=True)
class _Panel:
    """An image, or with a norm a map drawn in colours with a bar."""

    title: str
    values: NDArray[Any]
    norm: Normalize | None = None
    colours: Colormap = field(default_factory=lambda: DEPTH)  # has no hash
    label: str = ""


def _map_panels(
    title: str,
    sparse_depth: NDArray[Any],
    shown: NDArray[Any],
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"] | None,
    *,
    metric: bool,
) -> list[_Panel]:
    """`sparse_depth` where it is `shown`, under that title; result; uncertainty."""
    result = depth.cpu().numpy()
    sparse = sparse_picture(sparse_depth, shown, below=_SPARSE, radius=2 * _step(result))
    known = np.where(result > 0, result, np.nan) if metric else result
    scale = robust_range(known) if metric else Normalize(0, 1)
    panels = [
        _Panel(title, sparse, scale, label="depth [m]"),
        _Panel("result", known, scale, label="depth [m]" if metric else "relative depth"),
    ]
    if uncertainty is not None:
        error = uncertainty.cpu().numpy()
        norm = uncertainty_range(error)
        title = f"uncertainty, 98 % below {norm.vmax:.2g} m" if metric else "uncertainty"
        label = "standard deviation" + (" [m]" if metric else "")
        panels.append(_Panel(title, error, norm, ERROR, label))
    return panels


def _step(values: NDArray[Any]) -> int:
    longest: int = max(values.shape[:2])
    return -(-longest // _LONGEST_SIDE)


def _side_by_side(panels: Sequence[_Panel]) -> Figure:
    """Each value takes at least a pixel of the figure."""
    step = _step(panels[0].values)
    panels = [replace(panel, values=panel.values[::step, ::step]) for panel in panels]
    height, width = panels[0].values.shape[:2]
    panel_height = _PANEL_INCHES * height / width
    figure = Figure(
        figsize=(len(panels) * (_PANEL_INCHES + _GAP), _BELOW + panel_height + _ABOVE),
        dpi=max(width, _LEAST_WIDTH) / _PANEL_INCHES,
    )
    FigureCanvasAgg(figure)
    for column, panel in enumerate(panels):
        left = column * (_PANEL_INCHES + _GAP) + _GAP / 2
        axes = _axes(figure, left, _BELOW, _PANEL_INCHES, panel_height)
        axes.set_title(panel.title)
        axes.set_axis_off()
        drawn = axes.imshow(
            panel.values, cmap=panel.colours, norm=panel.norm, interpolation="nearest"
        )
        if panel.norm is not None:
            bar = _axes(figure, left, _BELOW - 0.2, _PANEL_INCHES, 0.12)
            figure.colorbar(drawn, cax=bar, orientation="horizontal", label=panel.label)
    return figure


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place and of a size in inches."""
    across, up = figure.get_size_inches()
    axes: Axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    return axes
