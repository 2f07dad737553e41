"""Products of three-vectors along the last axis, several times faster than numpy's own."""

import numpy as np
from jaxtyping import Float


def dot(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
    """Inner products."""
    product: Float[np.ndarray, "*n"] = (
        a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    )
    return product


def cross(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Cross products."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Vectors at length 1; zero stays zero."""
    length = np.sqrt(np.maximum(dot(vectors, vectors), 1e-18))
    scaled: Float[np.ndarray, "*n 3"] = vectors / length[..., None]
    return scaled
