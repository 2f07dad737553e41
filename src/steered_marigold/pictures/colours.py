"""The scales and colours of depth, error and uncertainty."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

# what is not known is grey
DEPTH = colormaps["turbo"].with_extremes(bad=(0.5, 0.5, 0.5))
ERROR = colormaps["magma"].with_extremes(bad=(0.5, 0.5, 0.5))
# metres; a scale of uncertainty shows at least so much, or it shows the noise of what was measured
LEAST_UNCERTAINTY = 0.05


def robust_range(values: NDArray[Any]) -> Normalize:
    """From the 1st to the 99th percentile of what is known (finite), never empty."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return Normalize(low, max(high, low + 1e-3))


def uncertainty_range(values: NDArray[Any]) -> Normalize:
    """From 0 to the 98th percentile of what is known, at least `LEAST_UNCERTAINTY`."""
    known = values[np.isfinite(values)]
    high = float(np.percentile(known, 98)) if known.size else 0.0
    return Normalize(0.0, max(high, LEAST_UNCERTAINTY))


def enlarged(values: NDArray[Any], *, radius: int) -> NDArray[Any]:
    """Every missing pixel (nan) within `radius` [px] of a known one takes the nearest's value."""
    distance, nearest = distance_transform_edt(np.isnan(values), return_indices=True)
    return np.where(distance <= radius, values[tuple(nearest)], np.nan)


def sparse_picture(
    sparse_depth: NDArray[Any], valid_mask: NDArray[Any], *, below: float, radius: int
) -> NDArray[Any]:
    """The measurements, nan elsewhere; larger than they are below a share of measured pixels."""
    depth = np.where(valid_mask, sparse_depth, np.nan)
    few = valid_mask.any() and valid_mask.mean() < below
    return enlarged(depth, radius=radius) if few else depth
