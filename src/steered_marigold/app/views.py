"""What the page's viewer gets: pictures on one colour scale, and the numbers behind them.

Everything is small enough to travel inside the page: pictures of at most `LONGEST_SIDE` pixels, and
of depth and uncertainty one number of 16 bits for each of their pixels.
"""

import base64
import zlib
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from matplotlib.colors import Colormap, Normalize
from numpy.typing import NDArray
from PIL import Image
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

LONGEST_SIDE = 960  # pixels; of larger frames every other pixel is shown, or less
_SPARSE, _RADIUS = 0.1, 2  # below this share of measured pixels they are drawn larger
_LARGEST_CODE = 65535
_COLOURS = 255  # of a palette; one more stands for "not known"

View = dict[str, Any]


def frame_view(frame: Frame) -> View:
    """Image and input, before anything was completed."""
    step = _step(frame)
    measured = _measured(frame)
    scale = robust_range(measured)
    pictures = [_image("Image", frame.image[::step, ::step]), _input(frame, step, scale)]
    return _view(frame, step, pictures, measured=measured)


def completed_view(given: Frame, completion: DepthCompletion, truth: Frame | None = None) -> View:
    """Image, input, result and uncertainty; all depths on the scale of the result.

    truth: the frame whose measurements were hidden from the completion; then the error is shown in
    the erased area too.
    """
    step = _step(given)
    depth = completion.depth[0].numpy()
    result = np.where(depth > 0, depth, np.nan) if completion.metric else depth
    scale = robust_range(result) if completion.metric else Normalize(0, 1)
    unit = "m" if completion.metric else "relative"
    pictures = [
        _image("Image", given.image[::step, ::step]),
        _input(given, step, scale),
        _picture("Result", result[::step, ::step], scale, DEPTH, "depth", unit),
    ]
    sigma, was = None, None
    if completion.uncertainty is not None:
        sigma = completion.uncertainty[0].numpy()
        style = (uncertainty_range(sigma), ERROR, "standard deviation", unit)
        pictures.append(_picture("Uncertainty", sigma[::step, ::step], *style))
    if truth is not None:
        was = np.where((truth.valid_mask & ~given.valid_mask).numpy(), truth.sparse_depth, np.nan)
        error = np.abs(result - was)
        style = (uncertainty_range(error), ERROR, "absolute error", unit)
        shown = _visible(error, truth.valid_mask.numpy(), step)
        pictures.append(_picture("Error in the hole", shown[::step, ::step], *style))
    measured = _measured(given)
    return _view(given, step, pictures, unit, measured=measured, depth=result, sigma=sigma, was=was)


def depth_pictures(frame: Frame, depths: Mapping[str, Tensor]) -> list[View]:
    """Several answers [m] to a frame, by title, on one scale."""
    step = _step(frame)
    scale = robust_range(np.stack([depth.numpy() for depth in depths.values()]))
    return [
        _picture(title, depth.numpy()[::step, ::step], scale, DEPTH, "depth", "m")
        for title, depth in depths.items()
    ]


def canvas_view(frame: Frame) -> View:
    """What holes are drawn on: the image, in the colours of depth where depth was measured."""
    step = _step(frame)
    image = frame.image[::step, ::step].numpy()
    colours = _colours(_input_picture(frame, step), robust_range(_measured(frame)), DEPTH)
    known = (colours != _COLOURS)[..., None]
    mixed = np.where(known, 0.45 * image + 0.55 * _palette(DEPTH)[colours], image)
    picture = _image("", torch.from_numpy(mixed.astype(np.uint8)))
    height, width = image.shape[:2]
    return {"src": picture["src"], "width": width, "height": height, "step": step}


def thumbnail(
    values: Float[Tensor, "height width"], scale: Normalize, colours: Colormap = DEPTH
) -> str:
    """A small map as the `src` of an <img>."""
    return _paletted(values.numpy(), scale, colours)


def _step(frame: Frame) -> int:
    return -(-max(frame.size) // LONGEST_SIDE)


def _measured(frame: Frame) -> NDArray[np.float32]:
    return np.where(frame.valid_mask.numpy(), frame.sparse_depth.numpy(), np.float32(np.nan))


def _visible(values: NDArray[Any], measured: NDArray[Any], step: int) -> NDArray[Any]:
    """Where little was measured, single pixels are hard to see: they are drawn larger."""
    known = np.isfinite(values)
    few = measured.mean() < _SPARSE
    return sparse_picture(values, known, below=1.1 if few else 0.0, radius=_RADIUS * step)


def _input_picture(frame: Frame, step: int) -> NDArray[Any]:
    return _visible(_measured(frame), frame.valid_mask.numpy(), step)[::step, ::step]


def _input(frame: Frame, step: int, scale: Normalize) -> View:
    share = float(frame.valid_mask.float().mean())
    title = f"Input, {share:.1%} measured"
    return _picture(title, _input_picture(frame, step), scale, DEPTH, "depth", "m")


def _image(title: str, pixels: UInt8[Tensor, "height width 3"]) -> View:
    content = BytesIO()
    Image.fromarray(pixels.numpy()).save(content, "JPEG", quality=88)
    return {"title": title, "src": _source("image/jpeg", content.getvalue()), "bar": None}


def _picture(
    title: str,
    values: NDArray[Any],
    scale: Normalize,
    colours: Colormap,
    quantity: str,
    unit: str,
) -> View:
    stops = [f"rgb({r} {g} {b})" for r, g, b in _palette(colours)[:_COLOURS:14].tolist()]
    low, high = float(scale.vmin or 0), float(scale.vmax or 0)
    bar = {"stops": stops, "low": low, "high": high, "quantity": quantity, "unit": unit}
    return {"title": title, "src": _paletted(values, scale, colours), "bar": bar}


def _paletted(values: NDArray[Any], scale: Normalize, colours: Colormap) -> str:
    picture = Image.fromarray(_colours(values, scale, colours))
    picture.putpalette(_palette(colours).tobytes())
    content = BytesIO()
    picture.save(content, "PNG")
    return _source("image/png", content.getvalue())


def _colours(values: NDArray[Any], scale: Normalize, colours: Colormap) -> NDArray[np.uint8]:
    """Indices into the palette; what is not known has the last one."""
    known = np.isfinite(values)
    shares = np.clip(scale(np.where(known, values, scale.vmin or 0.0)), 0, 1)
    return np.where(known, np.rint(shares * (_COLOURS - 1)), _COLOURS).astype(np.uint8)


def _palette(colours: Colormap) -> NDArray[np.uint8]:
    shares = np.append(np.linspace(0, 1, _COLOURS), np.nan)
    return np.asarray(np.rint(colours(shares)[:, :3] * 255), np.uint8)


def _view(
    frame: Frame,
    step: int,
    pictures: list[View],
    unit: str = "m",
    **maps: NDArray[Any] | None,
) -> View:
    height, width = frame.image[::step, ::step].shape[:2]
    packed = {k: _packed(v[::step, ::step]) for k, v in maps.items() if v is not None}
    size = {"width": width, "height": height, "step": step}
    return {**size, "unit": unit, "pictures": pictures, "maps": packed}


def _packed(values: NDArray[Any]) -> dict[str, Any]:
    """Multiples of `scale` in 16 bits, deflated, as base64; 0 = not known."""
    largest = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    scale = max(largest, 1e-6) / _LARGEST_CODE
    codes = np.where(np.isfinite(values), np.maximum(np.rint(np.nan_to_num(values) / scale), 1), 0)
    content = zlib.compress(codes.astype("<u2").tobytes(), 6)
    return {"scale": scale, "data": base64.b64encode(content).decode()}


def _source(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
