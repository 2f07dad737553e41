"""BP-Net as a `DepthCompleter`."""

from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from steered_marigold.core.geometry import crop_intrinsics
from steered_marigold.errors import InputError
from steered_marigold.methods.bpnet.network import MULTIPLE, BPNet
from steered_marigold.methods.learned import IMAGENET, ImageNormalization, LearnedCompleter

KITTI = ImageNormalization(mean=(90.9950, 96.2278, 94.3213), std=(79.2382, 80.5267, 82.1483))


class BPNetCompleter(LearnedCompleter):
    """BP-Net with its authors' weights. Needs K.

    The frame is taken at its own size, and padded to multiples of 32 on all sides alike, the image
    by its border, depth by nothing measured; the padding is cut off the answer. So 304x228 runs at
    320x256 as in the authors' evaluation, and 608x448 and 640x480 run as they are: larger than
    the 304x228 of the NYUv2 training, as in the tables of the SteeredMarigold paper. To compare
    with the authors' own figures, halve and crop the frames before depth is sampled.

    weights: the authors' file. trained_on: the data set of that file, which fixes how the image is
    normalised and depth is scaled (decimetres for NYUv2); the file itself does not tell.
    """

    name = "bpnet"

    def __init__(
        self,
        weights: Path,
        *,
        trained_on: Literal["nyuv2", "kitti"] = "nyuv2",
        device: str | torch.device = "cpu",
    ) -> None:
        with torch.device("meta"):
            network = BPNet()
        normalization = {"nyuv2": IMAGENET, "kitti": KITTI}[trained_on]
        super().__init__(network, weights, device=device, normalization=normalization)
        self._depth_scale = {"nyuv2": 10.0, "kitti": 1.0}[trained_on]

    def _predict(
        self,
        image: Float[Tensor, "1 3 height width"],
        sparse_depth: Float[Tensor, "1 1 height width"],
        K: Float[Tensor, "3 3"] | None,
    ) -> Float[Tensor, "1 1 height width"]:
        if K is None:
            raise InputError("bpnet works on 3D points: give it K, the camera's intrinsics [px]")
        height, width = image.shape[2:]
        top, left = -height % MULTIPLE // 2, -width % MULTIPLE // 2
        padding = (left, -width % MULTIPLE - left, top, -height % MULTIPLE - top)
        padded_K = crop_intrinsics(K, top=-top, left=-left).to(sparse_depth)
        dense: Tensor = self._network(
            F.pad(image, padding, mode="replicate"),
            F.pad(sparse_depth * self._depth_scale, padding),
            padded_K,
        )
        return dense[..., top : top + height, left : left + width] / self._depth_scale
