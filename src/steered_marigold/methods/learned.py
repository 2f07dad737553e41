"""What the learned baselines share: the checks, image normalisation, weights, the record."""

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.weights import load_published


@dataclass(frozen=True)
class ImageNormalization:
    """(image - mean) / std for each of red, green and blue in 0..255."""

    mean: tuple[float, float, float]
    std: tuple[float, float, float]


IMAGENET = ImageNormalization(mean=(123.675, 116.28, 103.53), std=(58.395, 57.12, 57.375))


class LearnedCompleter(DepthCompleter):
    """A `DepthCompleter` around one forward pass of a network with published weights.

    network: made on the meta device, so that no memory goes to weights that are replaced.

    Raises CheckpointError if the weights are missing or are not the network's.
    """

    def __init__(
        self,
        network: nn.Module,
        weights: Path,
        *,
        device: str | torch.device,
        normalization: ImageNormalization,
    ) -> None:
        load_published(network, weights)
        self._network = network.to(device, torch.float32).eval().requires_grad_(False)
        self._device = device
        self._normalization = normalization

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        sparse = torch.where(frame.valid_mask, frame.sparse_depth, 0)[None, None]
        mean, std = (
            torch.tensor(values, device=self._device)[:, None, None]
            for values in (self._normalization.mean, self._normalization.std)
        )
        normalized = (frame.image.to(self._device).permute(2, 0, 1) - mean) / std
        with torch.inference_mode():
            dense = self._predict(normalized[None], sparse.to(self._device, torch.float32), frame.K)
        measured = frame.valid_mask[None]
        return DepthCompletion(
            depth=dense[:, 0].to(frame.sparse_depth), measured=measured, trusted=measured
        )

    def describe(self) -> dict[str, Any]:
        return super().describe() | {"device": str(self._device), "dtype": "float32"}

    @abstractmethod
    def _predict(
        self,
        image: Float[Tensor, "1 3 height width"],
        sparse_depth: Float[Tensor, "1 1 height width"],
        K: Float[Tensor, "3 3"] | None,
    ) -> Float[Tensor, "1 1 height width"]:
        """Dense depth [m]. image: normalised. sparse_depth [m]: 0 where nothing was measured."""
