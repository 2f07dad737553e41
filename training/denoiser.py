"""Stage 3: the U-Net that denoises depth latents, on the frozen image encoder and codec.

In half of the samples a part of the frame is *known*: its latents carry no noise, whatever the
timestep says of the rest, as in the pipeline's second pass. So the U-Net learns to continue into
holes what it is told about their surroundings, in the units in which it is told.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import Any

import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from torch import Tensor, nn

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training import codec as codec_stage
from training import image_branch
from training.data import depth_range, image_to_model, normalise
from training.held_out import Truth
from training.losses import affine_errors
from training.mixture import MixedFrames, Sources, batches
from training.pool import Pool, encode_depth
from training.start import has_run, load_part
from training.terms import is_procedural
from training.trainer import Batch, Trainer

TEXT_CHANNELS = 32
# rows and columns of a 320x240 frame that validation hides: a centre like that of paper-erased
HOLE = slice(54, 186), slice(53, 267)
# how often a sample is at the first timestep, where a single step begins: of noise, and told
AT_FIRST = (0.2, 0.6)
# pull towards the identity when latents are matched, of latents of unit size
MATCH_RIDGE = 0.01
# share of the learning rate for weights that were trained before
AGAIN = 0.5
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

    Only the output of the latter is what a U-Net knows; see `latents_for_unet`.
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


def match_latents(new: Tensor, old: Tensor) -> tuple[Tensor, Tensor]:
    """Matrix [channels, channels] and offset that bring latents nearest to others.

    new, old: of the same images [n, channels, h, w]. Least squares, held near the identity where
    images say little.
    """
    x, y = (latents.float().movedim(1, -1).flatten(0, 2) for latents in (new, old))
    x_mean, y_mean = x.mean(dim=0), y.mean(dim=0)
    x, y = x - x_mean, y - y_mean
    pull = MATCH_RIDGE * len(x) * torch.eye(x.shape[1])
    matrix = torch.linalg.solve(x.T @ x + pull, x.T @ y + pull).T
    return matrix, y_mean - matrix @ x_mean


@torch.no_grad()
def latents_for_unet(
    encoder: ImageEncoder, start: Path | None, images: Tensor
) -> dict[str, Tensor]:
    """The "matrix" and "offset" by which a newly trained encoder's output goes to the U-Net.

    A U-Net that begins with a checkpoint's weights gets latents like that checkpoint's; a new one
    gets latents of unit size.
    """
    new = torch.cat([encoder(image[None]) for image in images])
    if start is None:
        matrix, offset = torch.eye(new.shape[1]) / new.std(), torch.zeros(new.shape[1])
    else:
        before = ImageEncoder.from_pretrained(start / "image_encoder")
        old = torch.cat([before(image[None]) for image in images])
        matrix, offset = match_latents(new, old)
    return {"matrix": matrix, "offset": offset}


@torch.no_grad()
def change_latents(encoder: ImageEncoder, matrix: Tensor, offset: Tensor) -> None:
    """Makes a matrix and an offset of the encoder's output a part of its last layer."""
    layer = encoder.conv_out
    assert layer.bias is not None
    layer.weight.copy_(torch.einsum("oi,ic...->oc...", matrix, layer.weight))
    layer.bias.copy_(matrix @ layer.bias + offset)


def draw_timesteps(told: Tensor, generator: torch.Generator) -> Tensor:
    """Timesteps of 1000, most of them in the noisier half: there image evidence decides.

    told: which samples are told something [n]; theirs are all in that half.
    """
    u, first = torch.rand(2, len(told), generator=generator)
    t = torch.where(told, 500 + 500 * u.sqrt(), 999 * u.sqrt()).round().long().clamp(max=999)
    of_noise, of_told = AT_FIRST
    return torch.where(first < torch.where(told, of_told, of_noise), 999, t)


@dataclass(frozen=True)
class Stage:
    """The U-Net and what surrounds it while it is trained.

    encoder: its output is what the U-Net sees. depth_scale: factor on the depth latents.
    """

    encoder: ImageEncoder
    codec: AutoencoderKL
    unet: UNet2DConditionModel
    scheduler: DDIMScheduler
    depth_scale: float
    generator: torch.Generator

    def velocity(self, unet: nn.Module, image: Tensor, noisy: Tensor, t: Tensor) -> Tensor:
        """The U-Net's output in float32."""
        both = torch.cat([image.float(), noisy], dim=1)
        both = both.contiguous(memory_format=torch.channels_last)
        prompt = torch.zeros(len(both), 2, TEXT_CHANNELS)
        with torch.autocast("cpu", torch.bfloat16):
            output: Tensor = unet(both, t, encoder_hidden_states=prompt, return_dict=False)[0]
        return output.float()

    def noise(self, image: Tensor) -> Tensor:
        """Noise for depth latents beside these image latents."""
        shape = (len(image), 4, *image.shape[-2:])
        return torch.randn(shape, generator=self.generator)

    @torch.no_grad()
    def answer(self, unet: nn.Module, image: Tensor, latents: Tensor) -> Tensor:
        """Decoded depth [n, height, width] after one step from noise, or from what is told."""
        x0 = -self.velocity(unet, image, latents, torch.tensor(999))
        with torch.autocast("cpu", torch.bfloat16):
            decoded: Tensor = self.codec.decode(x0 / self.depth_scale).sample
        return decoded.float().mean(dim=1).clamp(-1, 1)

    def first_answer(self, image: Tensor) -> Tensor:
        """As the pipeline's first pass."""
        return self.answer(self.unet, image, self.noise(image))

    def loss(self, batch: Batch) -> dict[str, Tensor]:
        """Squared error of the velocity where there is a truth."""
        latents = batch["latents"].float() * self.depth_scale
        known, counts = batch["known"], batch["counts"]
        told = known.flatten(1).any(dim=1)
        t = draw_timesteps(told, self.generator)
        noisy = self.scheduler.add_noise(latents, self.noise(batch["image"]), t)
        noisy = torch.where(known, batch["told"].float() * self.depth_scale, noisy)
        output = self.velocity(self.unet, batch["image"], noisy, t)
        # the velocity that leads to the latents, whatever noise the position has
        alpha_bar = self.scheduler.alphas_cumprod[t].view(-1, 1, 1, 1)
        target = (alpha_bar.sqrt() * noisy - latents) / (1 - alpha_bar).sqrt()
        error = (output - target).square().mean(dim=1, keepdim=True)
        told = told.view(-1, 1, 1, 1)
        return {
            "loss": error[counts].mean(),
            "holes": error[counts & told & ~known].mean(),
            "noise": error[counts & ~told].mean(),
        }

    @torch.no_grad()
    def validate(self, unet: nn.Module, frames: Mapping[str, Sequence[Truth]]) -> dict[str, float]:
        """Errors of the one-step estimate by kind; in rooms also told the truth around `HOLE`."""
        errors: dict[str, float] = {}
        for kind, truths in frames.items():
            rows = []
            for truth in truths[::2]:
                with torch.autocast("cpu", torch.bfloat16):
                    image = self.encoder(image_to_model(truth.image[None]))
                noise = self.noise(image)
                row = affine_errors(self.answer(unet, image, noise), truth.depth)
                if kind == "rooms":
                    row["hole"] = self._error_in_hole(unet, image, noise, truth.depth)
                rows.append(row)
            errors |= {f"{kind}_{name}": fmean(row[name] for row in rows) for name in rows[0]}
        return errors

    def _error_in_hole(self, unet: nn.Module, image: Tensor, noise: Tensor, depth: Tensor) -> float:
        """abs_rel in `HOLE`, in the units of what is told, the truth around it."""
        low, high = depth_range(depth.numpy())
        normalised = torch.from_numpy(normalise(depth[0].numpy()))[None, None]
        with torch.autocast("cpu", torch.bfloat16):
            told = encode_depth(self.codec, normalised).float() * self.depth_scale
        rows, columns = (slice(s.start // 8, -(-s.stop // 8)) for s in HOLE)
        told[..., rows, columns] = noise[..., rows, columns]
        metric = low + (self.answer(unet, image, told) + 1) / 2 * (high - low)
        return float(((metric - depth).abs() / depth)[..., HOLE[0], HOLE[1]].mean())


@torch.no_grad()
def _interfaces(
    encoder: ImageEncoder, codec: AutoencoderKL, start: Path | None, batch: Batch, *, new: bool
) -> dict[str, Any]:
    """How the outputs of both frozen parts come to the U-Net.

    new: whether the encoder was trained after that of `start`.
    """
    depth = 1 / float(torch.cat([encode_depth(codec, d[None]) for d in batch["depth"]]).std())
    if start is not None:  # what its U-Net was trained on
        depth = float(AutoencoderKL.load_config(start / "vae")["scaling_factor"])
    if not new:  # a checkpoint's encoder is exactly what its U-Net was trained on
        channels = encoder.config.latent_channels
        return {"matrix": torch.eye(channels), "offset": torch.zeros(channels), "depth": depth}
    return latents_for_unet(encoder, start, image_to_model(batch["image"])) | {"depth": depth}


def train(
    sources: Sources,
    runs: Path,
    *,
    minutes: float,
    tune: Mapping[str, Sequence[Truth]],
    start: Path | None = None,
    pool: int = 384,
) -> None:
    """Trains the U-Net on stages 1 and 2 in `runs`; `runs/denoiser/last.pt` holds it.

    tune: the frames on which the curve is measured, by kind.
    start: the checkpoint that gives what has no run in `runs`: the U-Net to begin with, and the
    frozen parts. None: the U-Net begins at random, and stages 1 and 2 must have been run.
    """
    encoder = load_image_encoder(runs / "image_branch", start)
    codec = load_codec(runs / "codec", start)
    data, run = batches(MixedFrames(sources, seed=2), 16), runs / "denoiser"
    if not (run / "scales.pt").exists():
        several = list(islice(data, 16))
        batch = {name: torch.cat([b[name] for b in several]) for name in several[0]}
        run.mkdir(parents=True, exist_ok=True)
        found = _interfaces(encoder, codec, start, batch, new=has_run(runs / "image_branch"))
        torch.save(found, run / "scales.pt")
    scales = torch.load(run / "scales.pt", weights_only=True)
    change_latents(encoder, scales["matrix"], scales["offset"])
    unet = build(encoder.config.latent_channels)
    again = has_run(run) or start is not None
    if not has_run(run):
        load_part(unet, start, "unet")
    for part in (encoder, codec, unet):
        part.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    generator = torch.Generator().manual_seed(0)
    scheduler = DDIMScheduler(**SCHEDULER)
    stage = Stage(encoder, codec, unet, scheduler, scales["depth"], generator)
    trainer = Trainer(
        stage.unet,
        [{"params": list(unet.parameters()), "lr": 6e-4 * (AGAIN if again else 1)}],
        run,
        minutes,
        sources.procedural_only and is_procedural(start),
    )
    samples = Pool(stage.encoder, stage.codec, stage.first_answer, data, pool)
    trainer.fit(
        samples.batches(32, renew_every=4), stage.loss, partial(stage.validate, frames=tune)
    )
