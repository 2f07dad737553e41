"""Stage 2: the codec, an AutoencoderKL in Stable Diffusion's layout at small width."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import torch
from diffusers import AutoencoderKL
from torch import Tensor, nn

from training.data import depth_range, image_to_model, normalise
from training.held_out import Truth
from training.losses import gradient_loss, nearness
from training.mixture import MixedFrames, Sources, batches
from training.start import has_run, load_part
from training.terms import is_procedural
from training.trainer import Batch, Trainer

CROP = 128
# rendered depth has the sharpest edges
SHARES = {"nyuv2": 0.4, "rgbd": 0.1, "rooms": 0.5}
# of a batch of 16, this many are colour images; the rest is depth
COLOUR = 3
# what the decoder must tolerate: the denoiser's latents are never exact
LATENT_NOISE = 0.05


def build() -> AutoencoderKL:
    """An untrained codec: 4 latent channels at one eighth of the resolution."""
    return AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4,
        block_out_channels=(16, 32, 48, 64),
        layers_per_block=1,
        latent_channels=4,
        norm_num_groups=8,
        mid_block_add_attention=False,
        scaling_factor=1.0,
    )


def codec_batch(batch: Batch, generator: torch.Generator) -> Tensor:
    """Random crops [16, 3, CROP, CROP] in [-1, 1]: grey depth, stretched at random, and colour."""
    height, width = batch["depth"].shape[-2:]
    y = int(torch.randint(height - CROP + 1, (), generator=generator))
    x = int(torch.randint(width - CROP + 1, (), generator=generator))
    window = (..., slice(y, y + CROP), slice(x, x + CROP))
    depth, image = batch["depth"][window], image_to_model(batch["image"][window])
    # steering encodes maps whose range is not that of a whole frame
    low, high = torch.rand(2, len(depth), 1, 1, 1, generator=generator)
    stretch = torch.rand(len(depth), 1, 1, 1, generator=generator) < 0.5
    squeezed = depth * (0.3 + 0.7 * low) + (high - 0.5) * 0.7
    depth = torch.where(stretch, squeezed.clamp(-1.05, 1.05), depth)
    return torch.cat((image[:COLOUR], depth[COLOUR:].expand(-1, 3, -1, -1)))


def reconstruction(
    codec: nn.Module, image: Tensor, generator: torch.Generator | None = None
) -> tuple[Tensor, Tensor]:
    """(decoded, latents) of images in [-1, 1]; with a generator, noise comes in between."""
    latents = codec.encode(image).latent_dist.mode()  # type: ignore[operator]
    noisy = latents
    if generator is not None:
        noisy = latents + LATENT_NOISE * torch.randn(latents.shape, generator=generator)
    return codec.decode(noisy).sample, latents  # type: ignore[operator]


@torch.no_grad()
def validate(codec: nn.Module, truths: Sequence[Truth]) -> dict[str, float]:
    """abs_rel of the true depth of held-out frames through encoder and decoder."""
    total = 0.0
    for depth in (truth.depth for truth in truths):
        low, high = depth_range(depth.numpy())
        x = torch.from_numpy(normalise(depth[0].numpy()))[None, None]
        with torch.autocast("cpu", torch.bfloat16):
            y = reconstruction(codec, x.expand(-1, 3, -1, -1))[0]
        y = y.float().mean(dim=1, keepdim=True).clamp(-1, 1)
        metric = low + (x + 1) / 2 * (high - low)
        relative = (y - x).abs() / 2 * (high - low) / metric
        total += float(relative[0][depth > 0].mean())
    return {"abs_rel": total / len(truths)}


def train(
    sources: Sources,
    run: Path,
    *,
    minutes: float,
    tune: Mapping[str, Sequence[Truth]],
    start: Path | None = None,
) -> None:
    """Trains the codec; `run/last.pt` holds it.

    It is trained on depth whose holes are filled: what it must give back is what it got.
    tune: the frames on which the curve is measured, by kind. start: the checkpoint to begin with,
    or None.
    """
    codec = build().to(memory_format=torch.channels_last)
    if not has_run(run):
        load_part(codec, start, "vae")
    generator = torch.Generator().manual_seed(0)

    def loss_function(batch: Batch) -> dict[str, Tensor]:
        image = codec_batch(batch, generator).to(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            decoded, latents = reconstruction(codec, image, generator)
        error = decoded.float() - image
        colour, depth = error[:COLOUR], error[COLOUR:]
        everywhere = torch.ones_like(depth, dtype=torch.bool)
        terms = {
            "depth": (nearness(image[COLOUR:], everywhere) * depth.abs()).mean(),
            "colour": colour.abs().mean(),
            "edges": gradient_loss(depth, everywhere),
            "size": latents.float().square().mean(),
        }
        loss = terms["depth"] + 0.3 * terms["edges"] + 0.1 * terms["colour"] + 1e-4 * terms["size"]
        return {"loss": loss} | terms

    data = MixedFrames(sources, seed=1, shares=SHARES)
    groups: list[dict[str, object]] = [{"params": list(codec.parameters()), "lr": 1.2e-3}]
    procedural_only = sources.procedural_only and is_procedural(start)
    trainer = Trainer(codec, groups, run, minutes, procedural_only)
    rooms = tune.get("rooms", ())[::4]
    trainer.fit(
        batches(data, 16), loss_function, partial(validate, truths=rooms) if rooms else None
    )
