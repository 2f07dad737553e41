"""Whole images, through the authors' procedure and through the pipeline."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from benchmarks import reference
from benchmarks.subjects import BenchmarkFrame
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline

REFERENCE = "reference"
# names of the tables to the call's arguments
RUNS: Mapping[str, Mapping[str, Any]] = {
    "paper": {"preset": "paper"},
    "default": {"preset": "default"},
    "default, steered": {"preset": "default", "steering_strength": 0.3},
    "default, steered, exact codec": {
        "preset": "default",
        "steering_strength": 0.3,
        "steering_codec": "exact",
    },
    "fast": {"preset": "fast"},
}
OURS = tuple(name for name in RUNS if name != "paper")


def reference_models(pipeline: SteeredMarigoldPipeline) -> reference.Models:
    """A pipeline's models as the reference takes them."""
    return reference.Models(
        unet=pipeline.unet,
        vae=pipeline.vae,
        encode_image=image_side(pipeline),
        prompt=reference.empty_prompt(pipeline.tokenizer, pipeline.text_encoder),
        noise=pipeline.scheduler.config,
    )


def run_reference(pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame) -> int:
    """The authors' procedure with the models of a pipeline; returns how many maps it steered."""
    height, width = frame.mask.shape
    generator = torch.Generator().manual_seed(0)
    reference.complete(
        reference_models(pipeline),
        2 * frame.unit_image[None] - 1,
        frame.sparse_depth.double().numpy(),
        frame.mask.numpy(),
        latents=torch.randn(1, 4, height // 8, width // 8, generator=generator),
        generator=generator,
        anchor_generator=torch.Generator().manual_seed(0),
        align=True,
    )
    return reference.STEPS


def run_pipeline(pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame, name: str) -> int:
    """A run of `RUNS` on the frame's own grid; returns how many maps it steered."""
    steered = 0

    def count(_: Any, step: int, timestep: Tensor, tensors: dict[str, Any]) -> dict[str, Any]:
        nonlocal steered
        if tensors["steering_target"] is not None:
            steered += len(tensors["latents"])
        return {}

    pipeline(
        frame.unit_image,
        frame.sparse_depth,
        frame.mask,
        processing_resolution=max(frame.mask.shape),
        generator=torch.Generator().manual_seed(0),
        callback_on_step_end=count,
        callback_on_step_end_tensor_inputs=("latents", "steering_target"),
        **RUNS[name],
    )
    return steered


def image_side(pipeline: SteeredMarigoldPipeline) -> Any:
    """What makes the image's latents: the image encoder, or the VAE where there is none."""
    if pipeline.image_encoder is not None:
        return pipeline.image_encoder
    vae = pipeline.vae
    return lambda pixels: vae.encode(pixels).latent_dist.mode() * vae.config.scaling_factor
