"""What the methods without weights share: one check, one record, NumPy in between."""

from abc import abstractmethod

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.methods.completer import DepthCompleter


class ClassicalCompleter(DepthCompleter):
    """A `DepthCompleter` that needs no weights, no randomness and no K."""

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        mask = frame.valid_mask.numpy(force=True)
        depth = np.where(mask, frame.sparse_depth.numpy(force=True), 0).astype(np.float32)
        dense = torch.from_numpy(self._fill(frame.image.numpy(force=True), depth, mask))
        measured = frame.valid_mask[None]
        return DepthCompletion(
            depth=dense.to(frame.sparse_depth)[None], measured=measured, trusted=measured
        )

    @abstractmethod
    def _fill(
        self,
        image: UInt8[np.ndarray, "height width 3"],
        sparse_depth: Float[np.ndarray, "height width"],
        valid_mask: Bool[np.ndarray, "height width"],
    ) -> Float[np.ndarray, "height width"]:
        """Dense depth [m]. sparse_depth is 0 where nothing was measured; something was."""
