"""Frames on disk, and a small completer that needs no checkpoint."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion

HEIGHT, WIDTH = 24, 32


class NearestCompleter:
    """The depth of the nearest measurement, a little noise, and uncertainty with distance."""

    name = "nearest"
    checkpoint = "none"
    preset = "default"
    num_inference_steps = 1
    device = torch.device("cpu")
    dtype = torch.float32

    def complete(
        self,
        image: Tensor,
        sparse_depth: Tensor,
        valid_mask: Tensor,
        K: Tensor | None = None,
        *,
        confidence: Tensor | None = None,
        no_measurements: bool = False,
        generator: torch.Generator | None = None,
    ) -> DepthCompletion:
        """As DepthCompleter says; measurements of confidence 0 are not trusted."""
        relative = image.float().mean(dim=2)[None] / 255
        if no_measurements:
            nothing = torch.zeros_like(relative, dtype=torch.bool)
            return DepthCompletion(depth=relative, measured=nothing, trusted=nothing, metric=False)
        trusted = valid_mask if confidence is None else valid_mask & (confidence > 0)
        distance, nearest = distance_transform_edt(~trusted.numpy(), return_indices=True)
        noise = 1e-3 * torch.rand(valid_mask.shape, generator=generator)
        depth = sparse_depth[tuple(torch.from_numpy(nearest))] + noise
        return DepthCompletion(
            depth=depth[None],
            uncertainty=torch.from_numpy(distance)[None].float() * 0.01,
            affine_depth=relative,
            scale=torch.tensor([4.0]),
            shift=torch.tensor([0.5]),
            measured=valid_mask[None],
            trusted=trusted[None],
        )


class SilentCompleter(NearestCompleter):
    """The same, without uncertainty."""

    def complete(self, *args: Any, **kwargs: Any) -> DepthCompletion:
        """As above."""
        answer = super().complete(*args, **kwargs)
        return DepthCompletion(depth=answer.depth, measured=answer.measured, trusted=answer.trusted)


@pytest.fixture
def completer() -> NearestCompleter:
    """A completer with uncertainty."""
    return NearestCompleter()


@pytest.fixture
def silent_completer() -> SilentCompleter:
    """A completer without uncertainty."""
    return SilentCompleter()


def _write_frame(image: Path, depth: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    Image.fromarray(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)).save(image)
    codes = rng.integers(500, 5000, (HEIGHT, WIDTH)).astype(np.uint16)
    codes[rng.random((HEIGHT, WIDTH)) < 0.5] = 0
    Image.fromarray(codes).save(depth)


@pytest.fixture
def frame_files(tmp_path: Path) -> tuple[Path, Path]:
    """An image and its half empty depth map."""
    _write_frame(tmp_path / "image.png", tmp_path / "depth.png", seed=0)
    return tmp_path / "image.png", tmp_path / "depth.png"


@pytest.fixture
def frame_folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two folders with three frames."""
    images, depths = tmp_path / "images", tmp_path / "depths"
    images.mkdir()
    depths.mkdir()
    for index in range(3):
        _write_frame(images / f"{index:04d}.png", depths / f"{index:04d}.png", seed=index)
    return images, depths
