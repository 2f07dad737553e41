"""A picture of what went in and what came out, for people."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from steered_marigold.io.files import AnyPath, atomic_write, require_suffix

_MISSING = (0.5, 0.5, 0.5)
_PANEL_INCHES, _GAP, _ABOVE, _BELOW = 4.8, 0.2, 0.35, 0.8
_LONGEST_SIDE = 1280  # pixels of a panel; larger frames are drawn at every other pixel, or less
_LEAST_WIDTH = 480  # pixels of a panel, so that its labels can be read
_SPARSE = 0.05  # below this share of measured pixels, single pixels are hard to see


def draw_panels(
    path: AnyPath,
    *,
    image: UInt8[Tensor, "height width 3"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"] | None = None,
    metric: bool = True,
) -> None:
    """Writes a .png: image, input, result and (if given) uncertainty, side by side.

    Depths [m], 0 in `depth` = unknown, share one colour scale: the 1st to 99th percentile of the
    result. What is missing is grey. Sparse measurements are drawn larger than they are. Without
    `metric` the result is relative, in [0, 1].

    Raises FileFormatError for another extension, InputError if `path` cannot be written.
    """
    require_suffix(path, (".png",))
    result, measured = depth.cpu().numpy(), valid_mask.cpu().numpy()
    height, width = result.shape
    step = -(-max(height, width) // _LONGEST_SIDE)
    sparse = np.where(measured, sparse_depth.cpu().numpy(), np.nan)
    if measured.any() and measured.mean() < _SPARSE:
        sparse = enlarged(sparse, radius=2 * step)
    known = np.where(result > 0, result, np.nan) if metric else result
    scale = robust_range(known) if metric else Normalize(0, 1)
    panels = [
        _Panel("image", image.cpu().numpy()),
        _Panel(f"input, {measured.mean():.1%} measured", sparse, scale, label="depth [m]"),
        _Panel("result", known, scale, label="depth [m]" if metric else "relative depth"),
    ]
    if uncertainty is not None:
        error = uncertainty.cpu().numpy()
        label = "standard deviation" + (" [m]" if metric else "")
        panels.append(_Panel("uncertainty", error, robust_range(error), "magma", label))
    figure = _side_by_side(
        [replace(panel, values=panel.values[::step, ::step]) for panel in panels]
    )
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png")


@dataclass(frozen=True)
class _Panel:
    """An image, or with a norm a map drawn in colours with a bar."""

    title: str
    values: NDArray[Any]
    norm: Normalize | None = None
    colours: str = "turbo"
    label: str = ""


def _side_by_side(panels: Sequence[_Panel]) -> Figure:
    """Each value takes at least a pixel of the figure."""
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
        colormap = colormaps[panel.colours].with_extremes(bad=_MISSING)
        drawn = axes.imshow(panel.values, cmap=colormap, norm=panel.norm, interpolation="nearest")
        if panel.norm is not None:
            bar = _axes(figure, left, _BELOW - 0.2, _PANEL_INCHES, 0.12)
            figure.colorbar(drawn, cax=bar, orientation="horizontal", label=panel.label)
    return figure


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place and of a size in inches."""
    across, up = figure.get_size_inches()
    axes: Axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    return axes


def robust_range(values: NDArray[Any]) -> Normalize:
    """From the 1st to the 99th percentile of what is known, never empty."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return Normalize(low, max(high, low + 1e-3))


def enlarged(values: NDArray[Any], *, radius: int) -> NDArray[Any]:
    """Every missing pixel (nan) within `radius` [px] of a known one takes the nearest's value."""
    distance, nearest = distance_transform_edt(np.isnan(values), return_indices=True)
    return np.where(distance <= radius, values[tuple(nearest)], np.nan)
