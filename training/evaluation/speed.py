"""How long each part of the model takes at its native resolution."""

from collections.abc import Callable

import torch

from benchmarks.measuring import Timing, measure_interleaved
from training.evaluation.subject import Findings, Row, Subject

WARM_UP, REPEATS = 5, 30


@torch.no_grad()
def speed(subject: Subject) -> Findings:
    """Milliseconds of each part on one frame, float32."""
    frame = subject.native(subject.frames[0])
    image_latents = subject.image_latents(frame)
    latents = subject.codec.encode(frame.normalised)
    predict, scheduler = subject.pipeline.predictor(image_latents), subject.scheduler
    t, generator = scheduler.timesteps[25], torch.Generator()
    parts: dict[str, Callable[[], object]] = {
        "image encoder": lambda: subject.image_latents(frame),
        "one U-Net step": lambda: scheduler.step(
            predict(latents, t), t, latents, generator=generator
        ),
        "decode": lambda: subject.codec.decode(latents),
        "encode": lambda: subject.codec.encode(frame.normalised),
    }
    timings = measure_interleaved(parts, warm_up=WARM_UP, repeats=REPEATS)
    rows = [{"part": name, **milliseconds(timing)} for name, timing in timings.items()]
    threads = torch.get_num_threads()
    title = f"320x240, float32, {threads} threads, {REPEATS} repeats after {WARM_UP}"
    return Findings({title: rows})


def milliseconds(timing: Timing) -> Row:
    """Median and spread [ms]."""
    seconds = {
        "median": timing.median,
        "fastest": min(timing.seconds),
        "slowest": max(timing.seconds),
    }
    return {f"{name}_ms": 1000 * value for name, value in seconds.items()}
