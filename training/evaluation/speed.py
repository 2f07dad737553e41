"""How long each part of the model takes at its native resolution."""

from collections.abc import Callable
from time import perf_counter

import numpy as np
import torch

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
    rows = [{"part": name, **milliseconds(run)} for name, run in parts.items()]
    threads = torch.get_num_threads()
    title = f"320x240, float32, {threads} threads, {REPEATS} repeats after {WARM_UP}"
    return Findings({title: rows})


def milliseconds(run: Callable[[], object]) -> Row:
    """Median and quartiles of the time [ms] that a function takes."""
    times = []
    for _ in range(WARM_UP + REPEATS):
        started = perf_counter()
        run()
        times.append(1000 * (perf_counter() - started))
    low, median, high = (float(x) for x in np.percentile(times[WARM_UP:], (25, 50, 75)))
    return {"median_ms": median, "quartile1_ms": low, "quartile3_ms": high}
