"""Interpolation of the measurements alone: the rows that every other method has to beat."""

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage

from steered_marigold.core.interpolation import ScatteredInterpolant
from steered_marigold.methods.classical import ClassicalCompleter


class NearestCompleter(ClassicalCompleter):
    """The depth of the nearest measured pixel (Euclidean, in pixels)."""

    name = "nearest"

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        rows, columns = ndimage.distance_transform_edt(
            ~valid_mask, return_distances=False, return_indices=True
        )
        return np.asarray(sparse_depth[rows, columns])


class LinearCompleter(ClassicalCompleter):
    """Linear interpolation over the Delaunay triangulation of the measured pixels.

    Outside their convex hull, and everywhere if they lie on one line: the nearest measurement.
    """

    name = "linear"

    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        if valid_mask.all():
            return sparse_depth
        # The Delaunay triangles at a pixel with eight measured neighbours reach no further than
        # those and cover no hole. Without such pixels the holes are filled as before (up to the
        # choice among points on one circle), and dense sensors 10 to 50 times as fast.
        surrounded = ndimage.binary_erosion(valid_mask, np.ones((3, 3)), border_value=1)
        rows, columns = np.nonzero(valid_mask & ~surrounded)
        points = torch.from_numpy(np.stack([columns, rows], axis=1))
        interpolant = ScatteredInterpolant(points, sparse_depth.shape)
        dense = interpolant(torch.from_numpy(sparse_depth[rows, columns])).numpy()
        return np.where(valid_mask, sparse_depth, dense)
