"""What the methods without weights share: one check, one record, NumPy in between."""

from abc import ABC, abstractmethod

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.methods.protocol import check_frame


class ClassicalCompleter(ABC):
    """A `DepthCompleter` that needs no weights, no randomness and no K."""

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
        """See `DepthCompleter.complete`."""
        check_frame(self.name, image, sparse_depth, valid_mask)
        mask = valid_mask.numpy(force=True)
        depth = np.where(mask, sparse_depth.numpy(force=True), 0).astype(np.float32)
        dense = torch.from_numpy(self._fill(image.numpy(force=True), depth, mask))
        measured = valid_mask[None]
        return DepthCompletion(
            depth=dense.to(sparse_depth)[None], measured=measured, trusted=measured
        )

    @abstractmethod
    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        """Dense depth [m]. sparse_depth is 0 where nothing was measured; something was."""
