"""Small completers that need no checkpoint, and frames on disk for them."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import distance_transform_edt

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.frames.sources import FrameFiles
from steered_marigold.methods.completer import DepthCompleter

HEIGHT, WIDTH = 24, 32


class NearestCompleter(DepthCompleter):
    """The depth of the nearest measurement, a little noise, and uncertainty with distance.

    Measurements of confidence 0 are not trusted. Without any, the image's brightness.
    """

    name = "nearest"
    answers_without_measurements = True

    def describe(self) -> dict[str, Any]:
        ran = {"checkpoint": "none", "preset": "default", "steps": 1}
        return super().describe() | ran | {"device": "cpu", "dtype": "float32"}

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        valid, relative = frame.valid_mask, frame.image.float().mean(dim=2)[None] / 255
        if not frame.measured:
            nothing = valid[None]
            return DepthCompletion(depth=relative, measured=nothing, trusted=nothing, metric=False)
        trusted = valid if frame.confidence is None else valid & (frame.confidence > 0)
        distance, nearest = distance_transform_edt(~trusted.numpy(), return_indices=True)
        noise = 1e-3 * torch.rand(valid.shape, generator=generator)
        depth = frame.sparse_depth[tuple(torch.from_numpy(nearest))] + noise
        return DepthCompletion(
            depth=depth[None],
            uncertainty=torch.from_numpy(distance)[None].float() * 0.01,
            affine_depth=relative,
            scale=torch.tensor([4.0]),
            shift=torch.tensor([0.5]),
            measured=valid[None],
            trusted=trusted[None],
        )


class SilentCompleter(NearestCompleter):
    """The same, without uncertainty."""

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        answer = super()._complete(frame, generator)
        return replace(answer, uncertainty=None, affine_depth=None, scale=None, shift=None)


def write_frames(folder: Path, names: Iterable[str]) -> FrameFiles:
    """Folders of frames, below a folder."""
    images, depths = folder / "images", folder / "depths"
    images.mkdir(parents=True)
    depths.mkdir()
    for seed, name in enumerate(names):
        write_frame(images / f"{name}.png", depths / f"{name}.png", seed=seed)
    return FrameFiles(image=images, depth=depths)


def write_frame(image: Path, depth: Path, seed: int) -> None:
    """An image and its half empty depth map, in millimetres."""
    rng = np.random.default_rng(seed)
    Image.fromarray(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)).save(image)
    codes = rng.integers(500, 5000, (HEIGHT, WIDTH)).astype(np.uint16)
    codes[rng.random((HEIGHT, WIDTH)) < 0.5] = 0
    Image.fromarray(codes).save(depth)
