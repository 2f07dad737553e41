"""One RGB-D frame with its ground truth."""

from dataclasses import dataclass

from jaxtyping import Bool, Float, UInt8
from torch import Tensor


@dataclass(frozen=True, kw_only=True)
class RgbdSample:
    """A frame of a data set.

    frame_id: unique within the data set, the order of results, e.g. "0042".
    image: RGB in 0..255. depth: ground truth [m], read only where valid_mask is True.
    sparse_depth, sparse_mask: what a sensor measured [m], where the data set comes with it.
    K: intrinsics [px], if known.
    """

    frame_id: str
    image: UInt8[Tensor, "height width 3"]
    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    sparse_depth: Float[Tensor, "height width"] | None = None
    sparse_mask: Bool[Tensor, "height width"] | None = None
    K: Float[Tensor, "3 3"] | None = None
