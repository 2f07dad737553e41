"""The one interface of every method in the tables."""

from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion


@runtime_checkable
class DepthCompleter(Protocol):
    """Completes the depth of one frame.

    `name` is the method's name in tables and file names, e.g. "linear" or "steered:paper".
    """

    name: str

    def complete(
        self,
        image: UInt8[Tensor, "height width 3"],
        sparse_depth: Float[Tensor, "height width"],
        valid_mask: Bool[Tensor, "height width"],
        K: Float[Tensor, "3 3"] | None = None,
        *,
        generator: torch.Generator | None = None,
    ) -> DepthCompletion:
        """Dense metric depth for one frame, with a batch axis of 1.

        image: RGB in 0..255. sparse_depth: [m], read only where valid_mask is True.
        K: intrinsics [px], for methods that use them. generator: the only source of randomness,
        a CPU generator.

        Raises NoMeasurementsError if valid_mask is False everywhere.
        """
        ...
