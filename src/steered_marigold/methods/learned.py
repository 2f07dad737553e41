"""What the learned baselines share: the checks, image normalisation, weights, the record."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor, nn

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.methods.protocol import check_frame
from steered_marigold.methods.weights import load_published


@dataclass(frozen=True)
class ImageNormalization:
    """(image - mean) / std for each of red, green and blue in 0..255."""

    mean: tuple[float, float, float]
    std: tuple[float, float, float]


IMAGENET = ImageNormalization(mean=(123.675, 116.28, 103.53), std=(58.395, 57.12, 57.375))


class LearnedCompleter(ABC):
    """A `DepthCompleter` around one forward pass of a network with published weights.

    network: made on the meta device, so that no memory goes to weights that are replaced.

    Raises CheckpointError if the weights are missing or are not the network's.
    """

    name: str

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
        sparse = torch.where(valid_mask, sparse_depth, 0)[None, None]
        mean, std = (
            torch.tensor(values, device=self._device)[:, None, None]
            for values in (self._normalization.mean, self._normalization.std)
        )
        normalized = (image.to(self._device).permute(2, 0, 1) - mean) / std
        with torch.inference_mode():
            dense = self._predict(normalized[None], sparse.to(self._device, torch.float32), K)
        measured = valid_mask[None]
        return DepthCompletion(
            depth=dense[:, 0].to(sparse_depth), measured=measured, trusted=measured
        )

    @abstractmethod
    def _predict(
        self,
        image: Float[Tensor, "1 3 height width"],
        sparse_depth: Float[Tensor, "1 1 height width"],
        K: Float[Tensor, "3 3"] | None,
    ) -> Float[Tensor, "1 1 height width"]:
        """Dense depth [m]. image: normalised. sparse_depth [m]: 0 where nothing was measured."""
