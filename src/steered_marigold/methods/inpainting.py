"""Image inpainting, applied to depth: Telea, Navier-Stokes, and Levin's colorization."""

from itertools import product
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from steered_marigold.errors import InputError
from steered_marigold.methods.classical import ClassicalCompleter

UNITS_PER_METRE = 1e6
NEIGHBOURS = [step for step in product((-1, 0, 1), repeat=2) if step != (0, 0)]


class OpenCvInpainter(ClassicalCompleter):
    """OpenCV's inpainting of the holes; measured pixels keep their values, the image is ignored.

    "telea": Telea, "An Image Inpainting Technique Based on the Fast Marching Method", 2004.
    "navier-stokes": Bertalmio, Bertozzi and Sapiro, "Navier-Stokes, Fluid Dynamics, and Image and
    Video Inpainting", CVPR 2001.

    Works in float32, not in the 8 bits of photographs, and in micrometres: OpenCV's Telea adds a
    term of about one unit, whatever the unit, at every pixel it fills. In metres that ruins the
    result (2 m became 5 m), in micrometres it is nothing.

    radius_px: neighbourhood of a pixel from which it is filled.
    """

    def __init__(
        self, algorithm: Literal["telea", "navier-stokes"], *, radius_px: float = 3.0
    ) -> None:
        if not radius_px >= 1:
            raise InputError(f"radius_px is {radius_px}; it must be at least 1")
        self.name = algorithm
        self.radius_px = radius_px
        self._flag = {"telea": cv2.INPAINT_TELEA, "navier-stokes": cv2.INPAINT_NS}[algorithm]

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        holes = (~valid_mask).astype(np.uint8)
        scaled = (sparse_depth * UNITS_PER_METRE).astype(np.float32)
        filled = cv2.inpaint(scaled, holes, self.radius_px, self._flag) / UNITS_PER_METRE
        return np.where(valid_mask, sparse_depth, filled).astype(np.float32)


class ColorizationCompleter(ClassicalCompleter):
    """Levin, Lischinski and Weiss, "Colorization using Optimization", SIGGRAPH 2004, as the NYU
    Depth V2 toolbox fills depth (`fill_depth_colorization`, alpha = 1).

    Solves (I - W + diag(valid_mask)) z = valid_mask * sparse_depth, where W averages each pixel's
    neighbours by their likeness in grey: depth varies where the image does. Measurements are soft
    constraints, so measured pixels are smoothed too. A direct solve in float64.
    """

    name = "colorization"

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        grey = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2GRAY)
        system = diags_array(1.0 + valid_mask.ravel()) - neighbour_weights(grey)
        # a diagonally dominant matrix of symmetric structure: no pivoting, half the fill-in
        factors = splu(
            system.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        dense = factors.solve(sparse_depth.ravel().astype(np.float64))
        return np.asarray(dense.reshape(sparse_depth.shape), np.float32)


def neighbour_weights(grey: Float[np.ndarray, "height width"]) -> coo_array:
    """W, [pixels, pixels], rows of sum 1: exp(-(difference in grey)^2 / s) over the 8 neighbours.

    grey: in [0, 1]. s is 0.6 of the variance in the 3x3 window, but never so small that the most
    similar neighbour weighs less than .01 before normalisation.
    """
    height, width = grey.shape
    padded = np.pad(grey.astype(np.float64), 1, constant_values=np.nan)
    around = np.stack(
        [padded[1 + y : 1 + y + height, 1 + x : 1 + x + width] for y, x in NEIGHBOURS]
    )
    squared = (around - grey) ** 2
    variance = np.nanvar(np.concatenate([around, grey[None]]), axis=0)
    least = np.nanmin(squared, axis=0) / -np.log(0.01)
    spread = np.maximum(np.maximum(0.6 * variance, least), 2e-6)
    weights = np.exp(-squared / spread)
    weights /= np.nansum(weights, axis=0)

    inside = ~np.isnan(weights)
    pixels = np.arange(grey.size).reshape(1, height, width)
    steps = np.array([y * width + x for y, x in NEIGHBOURS]).reshape(-1, 1, 1)
    rows = np.broadcast_to(pixels, weights.shape)[inside]
    columns = (pixels + steps)[inside]
    return coo_array((weights[inside], (rows, columns)), shape=(grey.size, grey.size))
