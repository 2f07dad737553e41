"""One RGB-D frame with its ground truth."""

from dataclasses import dataclass, replace

from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.frame import Frame


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A frame of a data set, and what is true of it.

    frame: as a sensor saw it; its `id` is unique within the data set and gives the order of
    results, e.g. "0042"; nothing is measured in it if the data set has the truth alone.
    metric_depth: ground truth [m], read only where metric_mask is True.
    """

    frame: Frame
    metric_depth: Float[Tensor, "height width"]
    metric_mask: Bool[Tensor, "height width"]

    @property
    def truth(self) -> Frame:
        """The frame with all of the truth as if it had been measured."""
        return replace(self.frame, sparse_depth=self.metric_depth, valid_mask=self.metric_mask)
