"""Stage 3: the U-Net that denoises depth latents, on the frozen image encoder and codec.

Neither the image encoder nor the codec changes, so their outputs are computed once for a pool of
augmented samples, of which a part is renewed as the training goes.

In half of the samples a part of the frame is *known*: its latents carry hardly any noise, whatever
the timestep says of the rest, as if a sensor had measured there. So the U-Net learns to continue
into holes what it is told about their surroundings, in the units in which it is told.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from torch import Tensor, nn

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training import codec as codec_stage
from training import image_branch
from training.data import MixedFrames, batches, depth_range, image_to_model, normalise
from training.image_branch import affine_errors, held_out_frames
from training.start import has_run, load_part
from training.terms import is_procedural
from training.trainer import Batch, Trainer

TEXT_CHANNELS = 32
# rows and columns of a 320x240 frame that validation hides: a centre like that of paper-erased
HOLE = slice(54, 186), slice(53, 267)
# known latents are noised to a timestep below this one
KNOWN_TIMESTEPS = 250
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


def load_image_encoder(run: Path, start: Path | None = None) -> ImageEncoder:
    """The trained image encoder, or without a run that of a checkpoint.

    Only the output of the latter is scaled already; `export.assemble` scales the other's.
    """
    regressor = image_branch.build()
    if start is None or has_run(run):
        average_of(run, regressor)
    else:
        load_part(regressor.encoder, start, "image_encoder")
    encoder: ImageEncoder = regressor.encoder.eval().requires_grad_(False)
    return encoder


def load_codec(run: Path, start: Path | None = None) -> AutoencoderKL:
    """The trained codec, or without a run that of a checkpoint; its output is not scaled."""
    codec = codec_stage.build()
    if start is None or has_run(run):
        return average_of(run, codec)
    load_part(codec, start, "vae")
    return codec.eval().requires_grad_(False)


@torch.no_grad()
def encode_depth(codec: AutoencoderKL, depth: Tensor) -> Tensor:
    """Unscaled latents of depth [n, 1, height, width] in [-1, 1]."""
    latents: Tensor = codec.encode(depth.expand(-1, 3, -1, -1)).latent_dist.mode()
    return latents


def told_in_other_units(depth: Tensor, generator: torch.Generator) -> Tensor:
    """Depth [n, 1, height, width] in [-1, 1], stretched and moved at random: no fit is exact."""
    scale, shift = torch.rand(2, len(depth), 1, 1, 1, generator=generator)
    moved: Tensor = depth * (0.75 + 0.5 * scale) + 0.4 * (shift - 0.5)
    return moved.clamp(-1.1, 1.1)


def draw_holes(depth: Tensor, generator: torch.Generator) -> Tensor:
    """True [n, 1, h, w] where nothing is known: in a box, in blobs, far away, or else
    but in a box or at scattered positions.

    depth: [n, 1, h, w], one value for each latent position.
    """
    count, _, h, w = depth.shape
    y, x = torch.linspace(0, 1, h)[:, None], torch.linspace(0, 1, w)
    side = 0.15 + 0.7 * torch.rand(count, 2, 1, 1, generator=generator)
    centre = 0.5 + (torch.rand(count, 2, 1, 1, generator=generator) - 0.5) * (1.2 - side)
    box = ((y - centre[:, 0]).abs() < side[:, 0] / 2) & ((x - centre[:, 1]).abs() < side[:, 1] / 2)
    coarse = torch.rand(count, 1, 4, 5, generator=generator)
    blobs = F.interpolate(coarse, size=(h, w), mode="bicubic")[:, 0] > 0.5
    limit = torch.rand(count, 1, 1, generator=generator) * 1.4 - 0.7
    far = depth[:, 0] > limit
    dense = 0.02 + 0.4 * torch.rand(count, 1, 1, generator=generator)
    scattered = torch.rand(count, h, w, generator=generator) > dense
    kinds = torch.stack([box, blobs, far, ~box, scattered])
    chances = torch.tensor([0.4, 0.2, 0.15, 0.1, 0.15])
    kind = torch.multinomial(chances, count, replacement=True, generator=generator)
    return kinds[kind, torch.arange(count)][:, None]


class Pool:
    """Encoded samples: image latents, depth latents and depth per latent, in bfloat16.

    "moved" tells which samples have their depth in other units than the normalised ones. Every
    draw replaces a little of the pool, so that the U-Net goes on seeing new crops.
    """

    def __init__(
        self, encoder: ImageEncoder, codec: AutoencoderKL, data: Iterator[Batch], size: int
    ) -> None:
        self._encoder, self._codec, self._data = encoder, codec, data
        self._generator = torch.Generator().manual_seed(0)
        chunks = [self._encode() for _ in range(size // 16)]
        self.samples = {name: torch.cat([chunk[name] for chunk in chunks]) for name in chunks[0]}
        self._oldest = 0

    @torch.no_grad()
    def _encode(self) -> Batch:
        batch = next(self._data)
        image = image_to_model(batch["image"]).contiguous(memory_format=torch.channels_last)
        depth = batch["depth"]
        moved = torch.rand(len(depth), 1, 1, 1, generator=self._generator) < 0.45
        depth = torch.where(moved, told_in_other_units(depth, self._generator), depth)
        with torch.autocast("cpu", torch.bfloat16):
            encoded = {"image": self._encoder(image), "latents": encode_depth(self._codec, depth)}
        coarse = F.avg_pool2d(depth, 8)
        return {k: v.bfloat16() for k, v in encoded.items()} | {"depth": coarse, "moved": moved}

    def batches(self, batch_size: int, renew_every: int) -> Iterator[Batch]:
        """Endless random batches."""
        size = len(self.samples["image"])
        while True:
            for _ in range(renew_every):
                index = torch.randint(size, (batch_size,), generator=self._generator)
                yield {name: values[index] for name, values in self.samples.items()}
            fresh = self._encode()
            count = len(fresh["image"])
            for name, values in fresh.items():
                self.samples[name][self._oldest : self._oldest + count] = values
            self._oldest = (self._oldest + count) % size


def draw_timesteps(count: int, generator: torch.Generator) -> Tensor:
    """Timesteps of 1000, two thirds of them in the noisier half: there image evidence decides."""
    u = torch.rand(count, generator=generator)
    return (u.sqrt() * 999).round().long().clamp(0, 999)


def train(
    nyuv2: Path | None,
    rooms: Path | None,
    runs: Path,
    *,
    minutes: float,
    held_out: Path | None = None,
    start: Path | None = None,
    pool: int = 3072,
) -> None:
    """Trains the U-Net on stages 1 and 2 in `runs`; `runs/denoiser/last.pt` holds it.

    held_out: the folder on whose tune split the curve is measured, or None.
    start: the checkpoint that gives what has no run in `runs`: the U-Net to begin with, and the
    frozen parts. None: the U-Net begins at random, and stages 1 and 2 must have been run.
    """
    encoder = load_image_encoder(runs / "image_branch", start)
    encoder = encoder.to(memory_format=torch.channels_last)
    codec = load_codec(runs / "codec", start).to(memory_format=torch.channels_last)
    data = MixedFrames(nyuv2, rooms, rooms_share=0.4, seed=2)
    samples = Pool(encoder, codec, batches(data, 16), pool)
    scales = {
        # a checkpoint's encoder is scaled already: exactly what its U-Net was trained on
        "image": 1 / float(samples.samples["image"].float().std())
        if has_run(runs / "image_branch")
        else 1.0,
        "depth": 1 / float(samples.samples["latents"].float().std()),
    }
    (runs / "denoiser").mkdir(parents=True, exist_ok=True)
    torch.save(scales, runs / "denoiser" / "scales.pt")
    unet = build(encoder.config.latent_channels).to(memory_format=torch.channels_last)
    if not has_run(runs / "denoiser"):
        load_part(unet, start, "unet")
    text = torch.zeros(1, 2, TEXT_CHANNELS)
    scheduler = DDIMScheduler(**SCHEDULER)
    generator = torch.Generator().manual_seed(0)

    def loss_function(batch: Batch) -> dict[str, Tensor]:
        image = batch["image"].float() * scales["image"]
        latents = batch["latents"].float() * scales["depth"]
        t = draw_timesteps(len(latents), generator)
        noise = torch.randn(latents.shape, generator=generator)
        # depth in other units can only be told from a part that is known
        chance = torch.rand(batch["moved"].shape, generator=generator)
        told = batch["moved"] | (chance < 0.15)
        told_t = (500 + 600 * torch.rand(len(t), generator=generator).sqrt()).long().clamp(max=999)
        t = torch.where(told.flatten(), told_t, t)
        little = torch.randint(KNOWN_TIMESTEPS, t.shape, generator=generator)
        known = told & ~draw_holes(batch["depth"], generator)
        noisy = torch.where(
            known,
            scheduler.add_noise(latents, noise, little),
            scheduler.add_noise(latents, noise, t),
        )
        both = torch.cat([image, noisy], dim=1).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            prompt = text.expand(len(both), -1, -1)
            output = unet(both, t, encoder_hidden_states=prompt, return_dict=False)[0]
        # the velocity that leads to the latents, whatever noise the position has
        alpha_bar = scheduler.alphas_cumprod[t].view(-1, 1, 1, 1)
        sigma = (1 - alpha_bar).sqrt()
        target = (alpha_bar.sqrt() * noisy - latents) / sigma
        error = (output.float() - target).square()
        return {
            "loss": error.mean(),
            "holes": error[(told & ~known).expand_as(error)].mean(),
            "noise": error[~told.flatten()].mean(),
        }

    tune = held_out_frames(held_out, "tune") if held_out else None

    @torch.no_grad()
    def validate(model: nn.Module) -> dict[str, float]:
        """Errors of the one-step estimate: from noise alone, and told what is around `HOLE`."""
        assert tune is not None
        estimates, holes = [], []
        t = torch.tensor(999)
        window = (..., *HOLE)
        for image, depth in zip(*tune, strict=True):
            normalised = torch.from_numpy(normalise(depth.numpy()))
            low, high = depth_range(depth.numpy())
            with torch.autocast("cpu", torch.bfloat16):
                features = encoder(image_to_model(image[None])).float() * scales["image"]
                noise = torch.randn(1, 4, *features.shape[-2:], generator=generator)
                latents = encode_depth(codec, normalised[None]).float() * scales["depth"]
                known = torch.ones_like(features[:, :1], dtype=torch.bool)
                rows, columns = (slice(s.start // 8, -(-s.stop // 8)) for s in HOLE)
                known[..., rows, columns] = False
                told = torch.where(known, latents, noise)
                both = torch.cat([features.expand(2, -1, -1, -1), torch.cat([noise, told])], dim=1)
                prompt = text.expand(2, -1, -1)
                v = model(both, t, encoder_hidden_states=prompt, return_dict=False)[0]
                decoded = codec.decode(-v.float() / scales["depth"]).sample
            estimate, filled = decoded.float().mean(dim=1, keepdim=True).clamp(-1, 1)
            estimates.append(estimate)
            metric = low + (filled + 1) / 2 * (high - low)
            holes.append(((metric - depth).abs() / depth)[window].mean())
        errors = affine_errors(torch.stack(estimates), tune[1])
        return errors | {"hole_abs_rel": float(torch.stack(holes).mean())}

    groups: list[dict[str, object]] = [{"params": list(unet.parameters()), "lr": 6e-4}]
    procedural_only = nyuv2 is None and is_procedural(start)
    Trainer(unet, groups, runs / "denoiser", minutes, procedural_only).fit(
        samples.batches(32, renew_every=4), loss_function, validate if tune else None
    )
