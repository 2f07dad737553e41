"""The denoising loop: the scheduler's step, then steering.

| code | paper |
|---|---|
| latents | x_t |
| predicted_x0 | x0~ |
| alpha_bar | alpha-bar_t |
| steering_strength | lambda = steering_strength * sqrt(1 - alpha_bar) |
"""

import warnings
from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from steered_marigold.core.steering import Steering, steering_update
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.continuation import Told
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators
from steered_marigold.errors import InputError

# (step, timestep, {"latents", "predicted_x0", "steering_target"}) -> the latents to go on with
StepEnd = Callable[[int, Tensor, dict[str, Tensor | None]], Tensor]


def denoise(
    predict: Callable[[Tensor, Tensor], Tensor],
    scheduler: Any,
    timesteps: Int[Tensor, " steps"],
    codec: DepthCodec | LinearCodec,
    latents: Float[Tensor, "batch channels h w"],
    *,
    generator: Generators,
    step_end: StepEnd,
    steering: Steering | None = None,
    steering_strength: float = 0.0,
    told: Told | None = None,
) -> Float[Tensor, "batch channels h w"]:
    """Depth latents from noise (the paper, Algorithm 1).

    predict: (latents, timestep) to the U-Net's output. scheduler: with its timesteps set.
    timesteps: those to run, the last ones of the scheduler's. codec: for steering alone. told: what
    a U-Net that continues known latents gets to see in their place.
    Without steering this is Marigold's own loop, operation by operation.
    """
    alpha_bar = scheduler.alphas_cumprod[timesteps.cpu()]
    strengths = (steering_strength * (1 - alpha_bar).sqrt()).to(latents)
    for i, t in enumerate(timesteps):
        if told is not None:
            latents = torch.where(told.known, told.latents, latents)
        out = scheduler.step(predict(latents, t), t, latents, generator=generator)
        # LCM's x0 is boundary-scaled and has another name
        predicted_x0 = out["denoised" if "denoised" in out else "pred_original_sample"]
        latents, target = out["prev_sample"], None
        if steering is not None:
            decoded = codec.decode(predicted_x0).float()
            target = steering.target(decoded, i)
            target_latents = codec.encode(target)
            latents = steering_update(latents, predicted_x0, target_latents, strengths[i])
        tensors = {"latents": latents, "predicted_x0": predicted_x0, "steering_target": target}
        latents = step_end(i, t, tensors)
    return latents


def last_timesteps(scheduler: Any, share: float) -> Int[Tensor, " steps"]:
    """The last `share` of the scheduler's timesteps, at least one; the scheduler begins there.

    The scheduler has its timesteps set. Raises InputError for a share not in (0, 1].
    """
    if not 0 < share <= 1:
        raise InputError(f"`restart` is {share}: it is a share of the steps, above 0 and up to 1")
    timesteps: Tensor = scheduler.timesteps
    first = len(timesteps) - max(1, round(share * len(timesteps)))
    if hasattr(scheduler, "set_begin_index"):
        scheduler.set_begin_index(first)
    return timesteps[first:]


def require_clean_estimate(scheduler: Any) -> None:
    """InputError for a scheduler whose steps do not state x0~, or whose latents are scaled."""
    if not _states_clean_estimate(type(scheduler)):
        raise InputError(
            f"the scheduler {type(scheduler).__name__} states no estimate of the clean sample in "
            "each step; use DDIMScheduler, DDPMScheduler or LCMScheduler"
        )


def _states_clean_estimate(kind: type[Any]) -> bool:
    """Found out by one step on nothing; the names are those that `denoise` reads."""
    scheduler, nothing = kind(), torch.zeros(1, 1, 1, 1)
    if getattr(scheduler, "init_noise_sigma", None) != 1.0:
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what others do inside: it is not going to be run
        try:
            scheduler.set_timesteps(2)
            out = scheduler.step(nothing, scheduler.timesteps[0], nothing)
        except (RuntimeError, TypeError, ValueError):  # asks for more than `denoise` gives
            return False
    return "denoised" in out or "pred_original_sample" in out
