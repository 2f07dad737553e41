"""Whether the U-Net denoises: its error falls with the noise, and it spreads what it is told."""

import torch
import torch.nn.functional as F
from torch import Tensor

from steered_marigold.evaluation.protocols import frame_generator
from training.evaluation.subject import SEED, Findings, NativeFrame, Row, Subject, mean_row

# 981 is where the paper's 50 steps begin
TIMESTEPS = (999, 981, 800, 500, 200)
REFERENCE = 981
NOISE_TIMESTEPS = (999, 981)
# latents of the true depth are this noisy inside the patch
PATCH_TIMESTEP = 50
PATCH = (10, 12)
RING = 4
CELL = 8


@torch.no_grad()
def denoising(subject: Subject) -> Findings:
    """Errors of x0 by timestep, and around a patch of true depth in noise."""
    by_timestep: dict[int, list[Row]] = {t: [] for t in TIMESTEPS}
    by_start: dict[int, list[Row]] = {t: [] for t in NOISE_TIMESTEPS}
    for frame_id in subject.frames:
        frame = subject.native(frame_id)
        image_latents = subject.image_latents(frame)
        latents = subject.codec.encode(frame.normalised)
        generator = frame_generator(SEED, frame_id, "method")
        noise = torch.randn(latents.shape, generator=generator)
        for t, rows in by_timestep.items():
            noisy = subject.scheduler.add_noise(latents, noise, torch.tensor([t]))
            rows.append(frame.errors(subject.estimate(noisy, t, image_latents)))
        for t, rows in by_start.items():
            rows.append(_around_patch(subject, frame, t, (latents, noise, image_latents)))
    means = {t: mean_row(rows) for t, rows in by_timestep.items()}
    return Findings(
        {
            "x0 from the true depth's latents at t": [
                {"t": t, **row, **_ratios(row, means[REFERENCE])} for t, row in means.items()
            ],
            f"x0 from noise, without and with a patch of {PATCH[0]}x{PATCH[1]} true latents "
            f"(at t = {PATCH_TIMESTEP}); abs_error in a ring of {RING} latents around it, "
            "and farther away": [
                {"t": t, **row, "ring_ratio": row["ring_with"] / row["ring_without"]}
                for t, row in ((t, mean_row(rows)) for t, rows in by_start.items())
            ],
        }
    )


def _ratios(row: Row, reference: Row) -> Row:
    return {f"{key}_ratio": row[key] / reference[key] for key in row}


def _around_patch(
    subject: Subject, frame: NativeFrame, t: int, parts: tuple[Tensor, Tensor, Tensor]
) -> Row:
    """Errors of x0 from noise at t, outside a patch whose latents are given and not.

    parts: latents of the true depth, noise, image latents, each [1, channels, h, w].
    """
    latents, noise, image_latents = parts
    patch = centre_patch((latents.shape[-2], latents.shape[-1]))
    told = subject.scheduler.add_noise(latents, noise, torch.tensor([PATCH_TIMESTEP]))
    starts = {"without": noise, "with": torch.where(patch, told, noise)}
    around = ring(patch, RING)
    row = {}
    for name, start in starts.items():
        decoded = subject.estimate(start, t, image_latents)
        for place, mask in (("ring", around), ("farther", ~(around | patch))):
            row[f"{place}_{name}"] = frame.errors(decoded, to_pixels(mask))["abs_error"]
    return row


def centre_patch(size: tuple[int, int]) -> Tensor:
    """True in the centred patch of a latent grid of `size` (height, width)."""
    mask = torch.zeros(size, dtype=torch.bool)
    top, left = (size[0] - PATCH[0]) // 2, (size[1] - PATCH[1]) // 2
    mask[top : top + PATCH[0], left : left + PATCH[1]] = True
    return mask


def ring(mask: Tensor, width: int) -> Tensor:
    """Positions outside a mask [h, w] and at most `width` rows and columns away from it."""
    grown = F.max_pool2d(mask[None].float(), 2 * width + 1, stride=1, padding=width)[0] > 0
    return grown & ~mask


def to_pixels(mask: Tensor) -> Tensor:
    """A mask of latents [h, w] as a mask of their pixels [1, height, width]."""
    return mask.repeat_interleave(CELL, dim=0).repeat_interleave(CELL, dim=1)[None]
