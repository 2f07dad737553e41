"""The embedded checkpoint's scheduler without diffusers, whose import takes seconds."""

from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

TRAIN_TIMESTEPS = 1000
BETAS = 0.00085, 0.012


class LightDdim:
    """`DDIMScheduler` as the embedded checkpoint sets it (Song et al., ICLR 2021, Eq. 12).

    Scaled-linear betas without signal at the last timestep (Lin et al., WACV 2024), trailing
    timesteps, velocities, nothing clipped, no noise added. The order of operations is diffusers'.
    """

    init_noise_sigma = 1.0

    def __init__(self) -> None:
        self.config = SimpleNamespace(num_train_timesteps=TRAIN_TIMESTEPS)
        self.alphas_cumprod = _alphas_cumprod()
        self.timesteps: Int[Tensor, " steps"]
        self._stride: int

    def set_timesteps(self, steps: int, device: torch.device | str | None = None) -> None:
        """So many steps, evenly spaced from the last timestep of training."""
        timesteps = np.round(np.arange(TRAIN_TIMESTEPS, 0, -TRAIN_TIMESTEPS / steps)) - 1
        self.timesteps = torch.from_numpy(timesteps.astype(np.int64)).to(device)
        self._stride = TRAIN_TIMESTEPS // steps

    def step(
        self,
        velocity: Float[Tensor, "*shape"],
        t: Any,
        latents: Float[Tensor, "*shape"],
        generator: object = None,
    ) -> dict[Literal["prev_sample", "pred_original_sample"], Float[Tensor, "*shape"]]:
        """The latents one step on, and the clean ones that the velocity implies.

        generator: nothing is drawn.
        """
        previous = int(t) - self._stride
        alpha_bar = self.alphas_cumprod[int(t)]
        next_alpha_bar = self.alphas_cumprod[previous] if previous >= 0 else torch.tensor(1.0)
        signal, noise = alpha_bar**0.5, (1 - alpha_bar) ** 0.5
        predicted_x0 = signal * latents - noise * velocity
        epsilon = signal * velocity + noise * latents
        moved = next_alpha_bar**0.5 * predicted_x0 + (1 - next_alpha_bar) ** 0.5 * epsilon
        return {"prev_sample": moved, "pred_original_sample": predicted_x0}

    def add_noise(
        self, clean: Float[Tensor, "batch *shape"], noise: Tensor, timesteps: Int[Tensor, " 1"]
    ) -> Float[Tensor, "batch *shape"]:
        """Clean latents with as much noise as belongs to a timestep."""
        alpha_bar = self.alphas_cumprod.to(clean)[timesteps.to(clean.device)]
        return alpha_bar**0.5 * clean + (1 - alpha_bar) ** 0.5 * noise


def _alphas_cumprod() -> Float[Tensor, " timesteps"]:
    first, last = (beta**0.5 for beta in BETAS)
    betas = torch.linspace(first, last, TRAIN_TIMESTEPS, dtype=torch.float32) ** 2
    signal = torch.cumprod(1.0 - betas, dim=0).sqrt()
    signal = (signal - signal[-1]) * (signal[0] / (signal[0] - signal[-1]))
    alphas_bar = signal**2
    alphas = torch.cat([alphas_bar[:1], alphas_bar[1:] / alphas_bar[:-1]])
    return torch.cumprod(1.0 - (1.0 - alphas), dim=0)
