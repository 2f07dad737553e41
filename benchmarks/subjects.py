"""What is measured: frames, the embedded checkpoint, and random models of the full size."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from steered_marigold.diffusion.checkpoints import load_pipeline
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image

# Stable Diffusion 2, with the image's latents beside the depth's
FULL_SIZE_UNET: Mapping[str, Any] = {
    "in_channels": 8,
    "out_channels": 4,
    "block_out_channels": (320, 640, 1280, 1280),
    "layers_per_block": 2,
    "cross_attention_dim": 1024,
    "attention_head_dim": (5, 10, 20, 20),
    "use_linear_projection": True,
}
FULL_SIZE_VAE: Mapping[str, Any] = {
    "down_block_types": ("DownEncoderBlock2D",) * 4,
    "up_block_types": ("UpDecoderBlock2D",) * 4,
    "block_out_channels": (128, 256, 512, 512),
    "layers_per_block": 2,
    "latent_channels": 4,
}
FULL_SIZE_PROMPT_CHANNELS = 1024
PAPER_FRACTION = 0.05
SAMPLE = Path(str(files("steered_marigold") / "assets" / "sample"))


@dataclass(frozen=True)
class BenchmarkFrame:
    """image: uint8 [height, width, 3]. sparse_depth: [m], [height, width]. mask: measured."""

    image: Tensor
    sparse_depth: Tensor
    mask: Tensor

    @property
    def unit_image(self) -> Tensor:
        """[3, height, width] in [0, 1]."""
        return self.image.permute(2, 0, 1).float() / 255

    def thinned(self, points: int) -> "BenchmarkFrame":
        """The frame with so many of its measurements, at random (seed 0)."""
        measured = self.mask.flatten().nonzero().flatten()
        order = torch.randperm(len(measured), generator=torch.Generator().manual_seed(0))
        mask = torch.zeros(self.mask.numel(), dtype=torch.bool)
        mask[measured[order[:points]]] = True
        return BenchmarkFrame(self.image, self.sparse_depth, mask.view_as(self.mask))


def sample_frame(width: int, height: int, points: int) -> BenchmarkFrame:
    """The package's sample, stretched to a size [px], with so many measurements at random."""
    image = read_image(SAMPLE / "image.jpg").pixels.numpy()
    measured = read_depth(SAMPLE / "depth.png")
    nearest = distance_transform_edt(
        ~measured.valid_mask.numpy(), return_distances=False, return_indices=True
    )
    depth = cv2.resize(measured.depth.numpy()[tuple(nearest)], (width, height))
    whole = BenchmarkFrame(
        torch.from_numpy(cv2.resize(np.array(image), (width, height))),
        torch.from_numpy(depth),
        torch.ones(height, width, dtype=torch.bool),
    )
    return whole.thinned(points)


def read_frame(folder: Path) -> BenchmarkFrame:
    """The sensor frame in a folder with an image named rgb and depth.png."""
    measured = read_depth(folder / "depth.png")
    image = read_image(next(folder.glob("rgb.*"))).pixels
    return BenchmarkFrame(image, measured.depth, measured.valid_mask)


def embedded_pipeline(dtype: torch.dtype = torch.float32) -> SteeredMarigoldPipeline:
    """The embedded checkpoint on the CPU, silent."""
    pipeline = load_pipeline("embedded", device="cpu", dtype=dtype)
    pipeline.set_progress_bar_config(disable=True)
    return pipeline


def stand_in_pipeline(steps: int) -> SteeredMarigoldPipeline:
    """The embedded models under a full checkpoint's number of steps by default.

    Their grid, latents and scheduler are those of a full checkpoint and their codec is trained, so
    schedule and everything outside the networks are a full checkpoint's; only the networks are not.
    """
    embedded = embedded_pipeline()
    pipeline = SteeredMarigoldPipeline(
        **embedded.components,
        prediction_type="depth",
        default_denoising_steps=steps,
        default_processing_resolution=768,
    )
    pipeline.set_progress_bar_config(disable=True)
    return pipeline


def full_size_unet() -> Any:
    """The U-Net of a Marigold checkpoint with random weights, 3.5 GB."""
    torch.manual_seed(0)
    return UNet2DConditionModel(**FULL_SIZE_UNET).eval()


def full_size_vae() -> Any:
    """The VAE of a Marigold checkpoint with random weights, 0.3 GB."""
    torch.manual_seed(0)
    return AutoencoderKL(**FULL_SIZE_VAE).eval()
