"""The one interface of every method in the tables."""

from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.errors import NoMeasurementsError, SizeMismatchError


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

        Raises SizeMismatchError if the sizes differ, NoMeasurementsError if valid_mask is False
        everywhere.
        """
        ...


def check_frame(name: str, image: Tensor, sparse_depth: Tensor, valid_mask: Tensor) -> None:
    """Raises what `DepthCompleter.complete` raises, in the words of the method `name`."""
    if not image.shape[:2] == sparse_depth.shape == valid_mask.shape:
        raise SizeMismatchError(
            f"{name}: image {tuple(image.shape[:2])}, sparse_depth {tuple(sparse_depth.shape)} "
            f"and valid_mask {tuple(valid_mask.shape)} must agree in height and width"
        )
    if not valid_mask.any():
        raise NoMeasurementsError(f"{name}: no pixel of valid_mask is True")
