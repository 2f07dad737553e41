"""Whether the edges of a depth map lie on those of its image, or would elsewhere."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, UInt8
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from steered_marigold.core.notices import Notice, Notices

_WORKING_SIZE = 320  # longest side [px] that edges are compared in
_FARTHEST = 0.07  # of the longest side: how far a depth map is moved
# of y and x, about the image's middle: mirrored, and as it is, smaller and larger
_MIRRORED = {
    (1.0, -1.0): "mirrored left to right",
    (-1.0, 1.0): "mirrored upside down",
    (-1.0, -1.0): "turned by 180 degrees",
}
_SCALES = (*((s, s) for s in (1.0, 0.9, 0.94, 0.97, 1.03, 1.06, 1.1)), *_MIRRORED)
_JUMP = 0.05  # relative difference of neighbouring depths at an edge
_FEWEST_EDGES = 250
_AT_REST = 3  # [px] of the working size: what counts as where it is
# standard deviations over all shifts
_CLEARLY, _BETTER, _MIRRORED_BETTER = 5.0, 2.2, 3.5


@dataclass(frozen=True)
class EdgeAgreement:
    """How well depth edges lie on image edges, in standard deviations over all shifts.

    here: as it is. best: at the best move, which is by `shift` (x, y) [px] after scaling the depth
    map's y and x by `scale` about the image's middle; below 0 is mirrored.
    """

    here: float
    best: float
    shift: tuple[int, int]
    scale: tuple[float, float]


def misalignment_doubts(
    image: UInt8[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> Notices:
    """A notice if the depth edges [m] would lie clearly better on the image's somewhere else.

    Measured on 1192 real frames: none outside TUM's fr1, where the camera moves fast and the two
    pictures are of different moments. Of frames moved by 20 px in 640 nine in ten are noticed, by
    12 px half, of those mirrored nine in ten, scaled by 7 % nearly all.
    """
    agreement = edge_agreement(image, depth, valid_mask)
    if agreement is None or agreement.best < max(_CLEARLY, agreement.here + _BETTER):
        return ()
    mirrored = _MIRRORED.get(agreement.scale)
    if mirrored is not None:
        if agreement.best < agreement.here + _MIRRORED_BETTER:  # a scene that is symmetrical
            return ()
        text = (
            f"The edges of the depth map do not meet those of the image; {mirrored} they would: "
            "turn one of both."
        )
        return (Notice("misaligned", text),)
    x, y = agreement.shift
    scaled = "" if agreement.scale == (1, 1) else f", scaled by {agreement.scale[0]:g},"
    text = (
        f"The edges of the depth map do not meet those of the image; moved by ({x}, {y}) px"
        f"{scaled} they would: is depth registered to the image? If not, give `depth_intrinsics` "
        "and `extrinsics`."
    )
    return (Notice("misaligned", text),)


def edge_agreement(
    image: UInt8[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> EdgeAgreement | None:
    """Compares edges at moves of up to 7 % of the longest side; None with too few depth edges.

    For each scale the agreement at all shifts at once is a correlation, by Fourier transform.
    """
    height, width = depth.shape
    step = max(1, round(max(height, width) / _WORKING_SIZE))
    grey = image.float().mean(dim=-1).cpu().numpy()
    strength = _image_edges(ndimage.uniform_filter(grey, step)[::step, ::step])
    edges = _depth_edges(
        depth[::step, ::step].cpu().numpy(), valid_mask[::step, ::step].cpu().numpy()
    )
    if len(edges) < _FEWEST_EDGES:
        return None
    reach = max(4, round(_FARTHEST * max(strength.shape)))
    surfaces = _agreements(strength, edges, reach)
    middle = surfaces[0]
    surfaces = (surfaces - middle.mean()) / max(float(middle.std()), 1e-12)
    at_rest = np.zeros(surfaces.shape[1:], bool)
    at_rest[(slice(reach - _AT_REST, reach + _AT_REST + 1),) * 2] = True
    here = float(surfaces[0, at_rest].max())
    # a mirrored map is moved no farther; what is as it is, is no other place
    surfaces[len(surfaces) - len(_MIRRORED) :, ~at_rest] = -np.inf
    surfaces[0, at_rest] = -np.inf
    best = np.unravel_index(int(surfaces.argmax()), surfaces.shape)
    return EdgeAgreement(
        here=here,
        best=float(surfaces[best]),
        shift=(int(best[2] - reach) * step, int(best[1] - reach) * step),
        scale=_SCALES[best[0]],
    )


def _image_edges(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Strength of edges, each relative to its surroundings, so that texture does not outweigh."""
    smooth = ndimage.gaussian_filter(grey, 1.0)
    gradient = np.hypot(ndimage.sobel(smooth, 0), ndimage.sobel(smooth, 1))
    surroundings = ndimage.uniform_filter(gradient, 31) + 4.0
    return np.asarray(np.minimum(gradient / surroundings, 4.0), np.float32)


def _depth_edges(depth: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Pixels [edges, 2] (y, x) on the near side of a jump between measured neighbours."""
    edge = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        a, b = (np.take(depth, _range(depth.shape[axis], side), axis) for side in (0, 1))
        both = np.take(valid, _range(depth.shape[axis], 0), axis) & np.take(
            valid, _range(depth.shape[axis], 1), axis
        )
        nearer_first = both & (b > a * (1 + _JUMP))
        nearer_second = both & (a > b * (1 + _JUMP))
        pad = [(0, 1), (0, 0)] if axis == 0 else [(0, 0), (0, 1)]
        edge |= np.pad(nearer_first, pad) | np.pad(nearer_second, [p[::-1] for p in pad])
    return np.argwhere(edge)


def _range(length: int, side: int) -> NDArray[np.int64]:
    return np.arange(length - 1) + side


def _agreements(
    strength: NDArray[np.float32], edges: NDArray[np.int64], reach: int
) -> NDArray[np.float32]:
    """Mean strength under the edges at each scale and shift of -reach..reach, [scale, y, x]."""
    shape = np.array(strength.shape)
    fast = [-(-(int(size) + 2 * reach) // 32) * 32 for size in shape]
    image_spectrum = _spectrum(np.pad(strength - strength.mean(), reach), fast)
    surfaces = []
    for scale in _SCALES:
        moved = np.rint((edges - shape / 2) * scale + shape / 2).astype(int) + reach
        inside = ((moved >= 0) & (moved < shape + 2 * reach)).all(axis=1)
        marks = np.zeros(fast, np.float32)
        marks[tuple(moved[inside].T)] = 1
        product = _spectrum(marks, fast).conj() * image_spectrum
        correlation = torch.fft.irfft2(product, fast).numpy()
        around = np.roll(correlation, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
        surfaces.append(around / max(marks.sum(), 1))
    return np.stack(surfaces)


def _spectrum(values: NDArray[np.float32], size: list[int]) -> Complex[Tensor, "rows columns"]:
    """PyTorch's transform, which is loaded already; SciPy's costs a quarter of a second."""
    spectrum: Tensor = torch.fft.rfft2(torch.from_numpy(values), size)
    return spectrum
