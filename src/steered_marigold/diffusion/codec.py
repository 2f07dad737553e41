"""Depth maps to latents and back: the only place that knows the VAE and its scaling."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


class DepthCodec:
    """A pipeline's VAE for grey depth maps in [-1, 1]: an `AutoencoderKL` or `AutoencoderTiny`.

    Only `vae.encode` and `vae.decode` are called, the entry points that offloading hooks.
    """

    def __init__(self, vae: Any) -> None:
        self.vae = vae
        self.scale = float(vae.config.scaling_factor)
        self.channels = int(vae.config.latent_channels)

    def encode(
        self, depth: Float[Tensor, "batch height width"]
    ) -> Float[Tensor, "batch channels h w"]:
        """Latents of depth maps; values beyond [-1, 1] are passed on as they are."""
        colour = depth[:, None].expand(-1, 3, -1, -1).to(self.vae.dtype)
        return self.encode_image(colour)

    def encode_image(
        self, image: Float[Tensor, "batch 3 height width"]
    ) -> Float[Tensor, "batch channels h w"]:
        """Latents of RGB images in [-1, 1]: the posterior's mode, scaled."""
        encoded = self.vae.encode(image)
        latents: Tensor = encoded["latents"] if "latents" in encoded else encoded.latent_dist.mode()
        return latents * self.scale

    def decode(
        self, latents: Float[Tensor, "batch channels h w"]
    ) -> Float[Tensor, "batch height width"]:
        """Depth maps in [-1, 1]: the mean of the three channels, clipped."""
        image = self.vae.decode(latents / self.scale, return_dict=False)[0]
        return torch.clip(image.mean(dim=1), -1.0, 1.0)
