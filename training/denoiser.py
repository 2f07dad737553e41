"""Stage 3: the U-Net that denoises depth latents, on the frozen image encoder and codec.

Neither the image encoder nor the codec changes, so their outputs are computed once for a pool of
augmented samples, of which a part is renewed as the training goes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from torch import Tensor, nn

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training import codec as codec_stage
from training import image_branch
from training.data import MixedFrames, batches, image_to_model
from training.image_branch import affine_errors, held_out_frames
from training.trainer import Batch, Trainer

TEXT_CHANNELS = 32
SCHEDULER: dict[str, Any] = {
    "beta_schedule": "scaled_linear",
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "prediction_type": "v_prediction",
    "timestep_spacing": "trailing",
    "rescale_betas_zero_snr": True,
    "clip_sample": False,
    "set_alpha_to_one": True,
}


def build(image_channels: int) -> UNet2DConditionModel:
    """An untrained U-Net for latents at one eighth of 320x240."""
    return UNet2DConditionModel(
        in_channels=image_channels + 4,
        out_channels=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "CrossAttnUpBlock2D", "UpBlock2D"),
        block_out_channels=(64, 96, 160),
        layers_per_block=1,
        cross_attention_dim=TEXT_CHANNELS,
        attention_head_dim=4,
        norm_num_groups=16,
    )


def average_of(run: Path, model: nn.Module) -> nn.Module:
    """The averaged weights of a stage's run, in a model of its kind."""
    saved = torch.load(run / "last.pt", weights_only=True)
    model.load_state_dict(saved["average"])
    return model.eval().requires_grad_(False)


def load_image_encoder(run: Path) -> ImageEncoder:
    """The trained image encoder; its output is scaled by `export.assemble`."""
    regressor = average_of(run, image_branch.build())
    encoder: ImageEncoder = regressor.encoder  # type: ignore[assignment]
    return encoder


def load_codec(run: Path) -> AutoencoderKL:
    """The trained codec."""
    return average_of(run, codec_stage.build())


@torch.no_grad()
def encode_depth(codec: AutoencoderKL, depth: Tensor) -> Tensor:
    """Unscaled latents of depth [n, 1, height, width] in [-1, 1]."""
    latents: Tensor = codec.encode(depth.expand(-1, 3, -1, -1)).latent_dist.mode()
    return latents


class Pool:
    """Encoded samples: image latents and depth latents, in bfloat16.

    Every draw replaces a little of the pool, so that the U-Net goes on seeing new crops.
    """

    def __init__(
        self, encoder: ImageEncoder, codec: AutoencoderKL, data: Iterator[Batch], size: int
    ) -> None:
        self._encoder, self._codec, self._data = encoder, codec, data
        chunks = [self._encode() for _ in range(size // 16)]
        self.image = torch.cat([image for image, _ in chunks])
        self.depth = torch.cat([depth for _, depth in chunks])
        self._oldest = 0

    @torch.no_grad()
    def _encode(self) -> tuple[Tensor, Tensor]:
        batch = next(self._data)
        image = image_to_model(batch["image"]).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            image = self._encoder(image)
            depth = encode_depth(self._codec, batch["depth"])
        return image.bfloat16(), depth.bfloat16()

    def batches(self, batch_size: int, renew_every: int) -> Iterator[Batch]:
        """Endless random batches."""
        generator = torch.Generator().manual_seed(0)
        while True:
            for _ in range(renew_every):
                index = torch.randint(len(self.image), (batch_size,), generator=generator)
                yield {"image": self.image[index], "depth": self.depth[index]}
            image, depth = self._encode()
            where = slice(self._oldest, self._oldest + len(image))
            self.image[where], self.depth[where] = image, depth
            self._oldest = (self._oldest + len(image)) % len(self.image)


def draw_timesteps(count: int, generator: torch.Generator) -> Tensor:
    """Timesteps of 1000, two thirds of them in the noisier half: there image evidence decides."""
    u = torch.rand(count, generator=generator)
    return (u.sqrt() * 999).round().long().clamp(0, 999)


def train(
    nyuv2: Path | None, rooms: Path | None, runs: Path, *, minutes: float, pool: int = 3072
) -> None:
    """Trains the U-Net on stages 1 and 2 in `runs`; `runs/denoiser/last.pt` holds it."""
    encoder = load_image_encoder(runs / "image_branch").to(memory_format=torch.channels_last)
    codec = load_codec(runs / "codec").to(memory_format=torch.channels_last)
    data = MixedFrames(nyuv2, rooms, rooms_share=0.4, seed=2)
    samples = Pool(encoder, codec, batches(data, 16), pool)
    scales = {
        "image": 1 / float(samples.image.float().std()),
        "depth": 1 / float(samples.depth.float().std()),
    }
    (runs / "denoiser").mkdir(parents=True, exist_ok=True)
    torch.save(scales, runs / "denoiser" / "scales.pt")
    unet = build(encoder.config.latent_channels).to(memory_format=torch.channels_last)
    text = torch.zeros(1, 2, TEXT_CHANNELS)
    scheduler = DDIMScheduler(**SCHEDULER)
    generator = torch.Generator().manual_seed(0)

    def loss_function(batch: Batch) -> dict[str, Tensor]:
        image = batch["image"].float() * scales["image"]
        depth = batch["depth"].float() * scales["depth"]
        t = draw_timesteps(len(depth), generator)
        noise = torch.randn(depth.shape, generator=generator)
        noisy = scheduler.add_noise(depth, noise, t)
        target = scheduler.get_velocity(depth, noise, t)
        both = torch.cat([image, noisy], dim=1).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            prompt = text.expand(len(both), -1, -1)
            output = unet(both, t, encoder_hidden_states=prompt, return_dict=False)[0]
        return {"loss": (output.float() - target).square().mean()}

    held_out = held_out_frames(nyuv2, "tune") if nyuv2 else None

    @torch.no_grad()
    def validate(model: nn.Module) -> dict[str, float]:
        """Errors of the one-step estimate from pure noise."""
        assert held_out is not None
        images, depths = held_out
        predictions = []
        t = torch.tensor(999)
        for image in images:
            with torch.autocast("cpu", torch.bfloat16):
                features = encoder(image_to_model(image[None])).float() * scales["image"]
                noise = torch.randn(1, 4, *features.shape[-2:], generator=generator)
                both = torch.cat([features, noise], dim=1)
                v = model(both, t, encoder_hidden_states=text, return_dict=False)[0]
                decoded = codec.decode(-v.float() / scales["depth"]).sample
            predictions.append(decoded.float().mean(dim=1, keepdim=True).clamp(-1, 1))
        return affine_errors(torch.cat(predictions), depths)

    groups: list[dict[str, object]] = [{"params": list(unet.parameters()), "lr": 6e-4}]
    Trainer(unet, groups, runs / "denoiser", minutes).fit(
        samples.batches(32, renew_every=4), loss_function, validate if nyuv2 else None
    )
