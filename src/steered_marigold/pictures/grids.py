"""Figures of equal panels, as evaluation and training draw them."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from steered_marigold.pictures.colours import DEPTH


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
    return show(axes, depth, title, cmap=DEPTH, norm=scale)
