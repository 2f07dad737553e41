"""The authors' procedure, written plainly: what the benchmarks compare with.

Float32, one image, DDPM with 50 steps; in each step the whole VAE decodes and encodes, P is drawn
anew and scipy triangulates it twice. Nothing here is shared with the package.

| code | paper |
|---|---|
| predicted | x0D = D(x0~), in [-1, 1] |
| condition | c, in [-1, 1] |
| points, known | P, and which of them were measured |
| lambda_t | lambda_t = STRENGTH * sqrt(1 - alpha_bar_t) |
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from diffusers import DDPMScheduler
from numpy.typing import NDArray
from scipy.interpolate import griddata
from torch import Tensor

STEPS = 50
STRENGTH = 0.1
ANCHOR_FRACTION = 0.05
PROMPT_TOKENS = 77
# zeta = 7: an ellipse of side 2 * 7 - 1
NEIGHBORHOOD = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (13, 13))

Map = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Models:
    """What the procedure takes from a checkpoint.

    encode_image: RGB in [-1, 1] to latents. prompt: [1, tokens, channels], of the empty prompt.
    noise: the configuration of a scheduler, for its betas and its prediction type.
    """

    unet: Any
    vae: Any
    encode_image: Callable[[Tensor], Tensor]
    prompt: Tensor
    noise: Mapping[str, Any]


@torch.no_grad()
def empty_prompt(tokenizer: Any, text_encoder: Any) -> Tensor:
    """The embedding [1, 77, channels] of the empty prompt, padded, without attention mask."""
    ids = tokenizer(
        "", padding="max_length", max_length=PROMPT_TOKENS, truncation=True, return_tensors="pt"
    ).input_ids
    embedding: Tensor = text_encoder(ids)[0]
    return embedding


@torch.no_grad()
def complete(
    models: Models,
    image: Tensor,
    sparse_depth: Map,
    mask: Mask,
    *,
    latents: Tensor,
    generator: torch.Generator,
    anchor_generator: torch.Generator,
    align: bool,
) -> Map:
    """Dense depth [m] of one frame, [height, width], at the size of the image.

    image: [1, 3, height, width] in [-1, 1]. sparse_depth: [m] where mask. latents: x_T.
    generator: the scheduler's noise. anchor_generator: P. align: fit c to x0D in every step (as
    for erased areas).
    """
    scheduler = _scheduler(models.noise)
    image_latents = models.encode_image(image)
    normalised = normalise(sparse_depth, mask)
    for t in scheduler.timesteps:
        both = torch.cat([image_latents, latents], dim=1)
        velocity = models.unet(both, t, encoder_hidden_states=models.prompt, return_dict=False)[0]
        out = scheduler.step(velocity, t, latents, generator=generator)
        predicted = decode(models.vae, out.pred_original_sample)
        condition = fit(normalised, predicted, mask) if align else normalised
        points, known = draw_positions(mask, anchor_generator)
        moved = move(predicted, condition, points, known)
        lambda_t = STRENGTH * (1 - scheduler.alphas_cumprod[t]).sqrt()
        change = encode(models.vae, moved) - out.pred_original_sample
        latents = out.prev_sample + lambda_t * change
    return fit((decode(models.vae, latents) + 1) / 2, sparse_depth, mask)


def _scheduler(noise: Mapping[str, Any]) -> Any:
    """DDPM with Stable Diffusion 2's settings and the checkpoint's betas."""
    taken = ("beta_start", "beta_end", "beta_schedule", "prediction_type", "rescale_betas_zero_snr")
    scheduler = DDPMScheduler(
        num_train_timesteps=1000,
        timestep_spacing="leading",
        steps_offset=1,
        clip_sample=False,
        variance_type="fixed_small",
        **{name: noise[name] for name in taken},
    )
    scheduler.set_timesteps(STEPS)
    return scheduler


def decode(vae: Any, latents: Tensor) -> Map:
    """D: depth [height, width] in [-1, 1], the clipped mean of the channels."""
    decoded = vae.decode(latents / vae.config.scaling_factor, return_dict=False)[0]
    depth: Map = decoded[0].float().mean(dim=0).clip(-1, 1).double().numpy()
    return depth


def encode(vae: Any, depth: Map) -> Tensor:
    """E: latents of three equal channels; nothing is clipped."""
    grey = torch.from_numpy(depth).to(vae.dtype).expand(1, 3, -1, -1)
    latents: Tensor = vae.encode(grey).latent_dist.mode() * vae.config.scaling_factor
    return latents


def normalise(sparse_depth: Map, mask: Mask) -> Map:
    """c mapped by its own minimum and maximum to [-1, 1]; 0 where all measurements are equal."""
    low, high = sparse_depth[mask].min(), sparse_depth[mask].max()
    if high == low:
        return np.zeros_like(sparse_depth)
    scaled: Map = np.where(mask, 2 * (sparse_depth - low) / (high - low) - 1, 0)
    return scaled


def fit(source: Map, target: Map, mask: Mask) -> Map:
    """M: the source mapped to the target by least squares over the mask.

    The ratio of means takes the place of a slope <= 0.
    """
    s, t = source[mask], target[mask]
    (slope, shift), *_ = np.linalg.lstsq(np.stack((s, np.ones_like(s)), axis=1), t, rcond=None)
    if slope <= 0:
        slope, shift = t.mean() / s.mean(), 0.0
    fitted: Map = slope * source + shift
    return fitted


def draw_positions(
    mask: Mask, generator: torch.Generator
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """P as (x, y) [px], and which of it was measured.

    Every known pixel, 5 % of all pixels kept outside the neighbourhood of known ones, the corners.
    """
    pixels = mask.size
    drawn = np.zeros(pixels, dtype=bool)
    drawn[torch.randperm(pixels, generator=generator)[: round(ANCHOR_FRACTION * pixels)]] = True
    near = cv2.dilate(mask.astype(np.uint8), NEIGHBORHOOD) > 0
    positions = mask | (drawn.reshape(mask.shape) & ~near)
    positions[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    y, x = np.nonzero(positions)
    return np.stack((x, y), axis=1), mask[y, x]


def move(predicted: Map, condition: Map, points: NDArray[np.int64], known: Mask) -> Map:
    """x0D - phi1 + phi2: interpolates x0D at P, and c where it is known with x0D elsewhere."""
    height, width = predicted.shape
    grid = tuple(np.meshgrid(np.arange(width), np.arange(height)))
    x, y = points.T
    at_points = predicted[y, x]
    phi1 = griddata(points, at_points, grid, method="linear")
    phi2 = griddata(points, np.where(known, condition[y, x], at_points), grid, method="linear")
    moved: Map = predicted - phi1 + phi2
    return moved
