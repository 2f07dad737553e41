"""A picture of what went in and what came out, for people."""

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
_PANEL_INCHES = 4.8
_LONGEST_SIDE = 1280  # pixels of a panel; larger frames are drawn coarser
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
        sparse = _enlarged(sparse, radius=2 * step)
    known = np.where(result > 0, result, np.nan) if metric else result
    scale = _robust_range(known) if metric else Normalize(0, 1)
    unit = "depth [m]" if metric else "relative depth"

    panels: list[tuple[str, NDArray[Any], Normalize | None, str, str]] = [
        ("image", image.cpu().numpy(), None, "", ""),
        (f"input, {measured.mean():.1%} measured", sparse, scale, "turbo", "depth [m]"),
        ("result", known, scale, "turbo", unit),
    ]
    if uncertainty is not None:
        spread = uncertainty.cpu().numpy()
        panels.append(("uncertainty", spread, _robust_range(spread), "magma", "uncertainty [m]"))

    size = (_PANEL_INCHES * len(panels), _PANEL_INCHES * height / width + 1.0)
    figure = Figure(figsize=size, dpi=min(max(width, height), _LONGEST_SIDE) / _PANEL_INCHES)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    for column, (title, values, norm, colours, label) in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), column + 1)
        axes.set_title(title)
        axes.set_axis_off()
        _draw(axes, values[::step, ::step], norm, colours, label)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png")


def _draw(
    axes: Axes, values: NDArray[Any], norm: Normalize | None, colours: str, label: str
) -> None:
    """An image, or (with a norm) a map in colours with its bar."""
    if norm is None:
        axes.imshow(values, interpolation="nearest")
        return
    colormap = colormaps[colours].with_extremes(bad=_MISSING)
    drawn = axes.imshow(values, cmap=colormap, norm=norm, interpolation="nearest")
    axes.figure.colorbar(drawn, ax=axes, location="bottom", label=label, shrink=0.9)


def _robust_range(values: NDArray[Any]) -> Normalize:
    """From the 1st to the 99th percentile of what is known, never empty."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return Normalize(low, max(high, low + 1e-3))


def _enlarged(values: NDArray[Any], *, radius: int) -> NDArray[Any]:
    """Every missing pixel within `radius` of a known one takes the nearest one's value."""
    distance, nearest = distance_transform_edt(np.isnan(values), return_indices=True)
    return np.where(distance <= radius, values[tuple(nearest)], np.nan)
