"""Whether samples are calibrated: their mean is good, and their spread tells where it is not."""

from copy import copy

import torch
from diffusers import DDPMScheduler
from torch import Tensor

from steered_marigold.core.alignment import fit_scale_shift
from steered_marigold.core.metrics import depth_errors, uncertainty_errors
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.evaluation.protocols import PreparedFrame
from training.evaluation.subject import Findings, Row, Subject, mean_row

AREA = "608x448"
Sampler = tuple[SteeredMarigoldPipeline, int]


def calibration(subject: Subject) -> Findings:
    """One-step estimates against samples of more steps, with several seeds each."""
    samplers = _samplers(subject)
    rows: dict[str, list[Row]] = {name: [] for name in samplers}
    for frame_id in subject.frames:
        frame = subject.prepared("paper-uniform", frame_id)
        for name, (pipeline, steps) in samplers.items():
            rows[name].append(sample_errors(draw(pipeline, frame, steps, subject.samples), frame))
    means = {name: mean_row(values) for name, values in rows.items()}
    one_step = next(iter(means.values()))["single_rmse_m"]
    table = [
        {
            "sampler": name,
            **row,
            "single_ratio": row["single_rmse_m"] / one_step,
            "mean_ratio": row["mean_rmse_m"] / one_step,
        }
        for name, row in means.items()
    ]
    title = (
        f"{subject.samples} samples a frame, scale and shift fitted on the 5 % samples; ratios to "
        "a single sample of the first row; spread_units in units of [-1, 1]"
    )
    return Findings({title: table})


def _samplers(subject: Subject) -> dict[str, Sampler]:
    """The checkpoint's scheduler at one step and the two largest numbers; DDPM at the largest."""
    pipeline, most = subject.pipeline, subject.steps[-1]
    ddpm = copy(pipeline)  # the same models
    ddpm.scheduler = DDPMScheduler.from_config(pipeline.scheduler.config)
    name = type(pipeline.scheduler).__name__.removesuffix("Scheduler")
    numbers = (1, *subject.steps[-2:])
    samplers = {f"{name}, steps {n}": (pipeline, n) for n in numbers}
    return {**samplers, f"DDPM, steps {most}": (ddpm, most)}


def draw(
    pipeline: SteeredMarigoldPipeline, frame: PreparedFrame, steps: int, samples: int
) -> Tensor:
    """Unsteered samples [samples, height, width] in [0, 1], of seeds 0, 1, ..."""
    image = frame.shown.image.permute(2, 0, 1).float() / 255
    answer = pipeline(
        image[None].expand(samples, -1, -1, -1),
        preset=None,
        num_inference_steps=steps,
        generator=[torch.Generator().manual_seed(seed) for seed in range(samples)],
    )
    affine: Tensor = answer.affine_depth
    return affine


def sample_errors(samples: Tensor, frame: PreparedFrame) -> Row:
    """Errors of samples [n, height, width] in [0, 1] of one frame, each fitted on its own.

    single_rmse_m: the mean over them. mean_rmse_m: of their mean. spearman: of their standard
    deviation and the absolute error of the mean. spread_units: that deviation before the fit, in
    units of [-1, 1].
    """
    mask = frame.areas[AREA]
    metric, mean = fitted(samples, frame), fitted(samples.mean(dim=0, keepdim=True), frame)[0]
    singles = [depth_errors(depth, frame.metric_depth, mask).rmse_m for depth in metric]
    spread = metric.std(dim=0)
    return {
        "single_rmse_m": sum(singles) / len(singles),
        "mean_rmse_m": depth_errors(mean, frame.metric_depth, mask).rmse_m,
        "spearman": uncertainty_errors(mean, spread, frame.metric_depth, mask).spearman,
        "spread_units": float(2 * samples.std(dim=0).mean()),
    }


def fitted(affine: Tensor, frame: PreparedFrame) -> Tensor:
    """Affine-invariant maps [n, height, width] to metres, by least squares on the measurements."""
    depth = frame.shown.sparse_depth.expand_as(affine)
    mask = frame.shown.valid_mask.expand_as(affine)
    metric: Tensor = fit_scale_shift(affine, depth, mask).apply(affine)
    return metric
