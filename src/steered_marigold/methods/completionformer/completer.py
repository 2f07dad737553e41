"""CompletionFormer as a `DepthCompleter`."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import InputError
from steered_marigold.methods.completionformer.network import MIN_SIDE, CompletionFormer
from steered_marigold.methods.learned import IMAGENET, LearnedCompleter


class CompletionFormerCompleter(LearnedCompleter):
    """CompletionFormer with its authors' weights, for NYUv2 or KITTI alike. K is not used.

    The frame is taken at its own size, without padding: the network rounds odd sizes down where
    it halves and resizes on the way back, and it was trained so (304x228 is no multiple of 32). A
    frame of 608x448 or 640x480 is larger than the 304x228 of the NYUv2 training, as in the tables
    of the SteeredMarigold paper. To compare with the authors' own figures, halve and crop the
    frames before depth is sampled; of KITTI, cut off the top 100 rows.

    weights: the authors' file.
    """

    name = "completionformer"

    def __init__(self, weights: Path, *, device: str | torch.device = "cpu") -> None:
        with torch.device("meta"):
            network = CompletionFormer()
        super().__init__(network, weights, device=device, normalization=IMAGENET)

    def _predict(
        self,
        image: Float[Tensor, "1 3 height width"],
        sparse_depth: Float[Tensor, "1 1 height width"],
        K: Float[Tensor, "3 3"] | None,
    ) -> Float[Tensor, "1 1 height width"]:
        if min(image.shape[2:]) < MIN_SIDE:
            height, width = image.shape[2:]
            raise InputError(
                f"completionformer needs images of {MIN_SIDE} px a side or more; this one has "
                f"{width}x{height}"
            )
        dense: Tensor = self._network(image, sparse_depth)
        return dense
