"""How often a run calls each network, counted while it runs, and what the same run costs with other
networks."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline


@dataclass(frozen=True)
class Call:
    """One call of a network with so many samples; start and end in seconds."""

    network: str
    samples: int
    start: float
    end: float

    @property
    def seconds(self) -> float:
        return self.end - self.start


@dataclass(frozen=True)
class Schedule:
    """A run in samples through each network: a batch of four counts as four.

    image, unet, decode, encode: through the image side, the U-Net and the exact codec; final: how
    many of `decode` are the answer's. approximate_decode, approximate_encode: maps that steered
    without the exact codec. Seconds outside the networks: before the first step (preparation of
    measurements and steering), during the steps, and after them (finish).
    """

    image: int
    unet: int
    decode: int
    encode: int
    final: int
    approximate_decode: int
    approximate_encode: int
    before_s: float
    loop_s: float
    after_s: float


@dataclass(frozen=True)
class Extrapolation:
    """The time of an image [s], and what steering takes as a share of the U-Net's time."""

    seconds: float
    steering_share: float


def extrapolate(schedule: Schedule, seconds: Mapping[str, float]) -> Extrapolation:
    """The schedule with networks that take so long for one sample [s].

    seconds: of "image", "unet", "decode", "encode". Steering is its calls of the codec, its
    preparation, and everything else in the loop.
    """
    unet = schedule.unet * seconds["unet"]
    decode, encode = seconds["decode"], schedule.encode * seconds["encode"]
    steering = (schedule.decode - schedule.final) * decode + encode
    steering += schedule.before_s + schedule.loop_s
    outside = schedule.image * seconds["image"] + schedule.final * decode + schedule.after_s
    return Extrapolation(outside + unet + steering, steering / unet)


def observe(pipeline: SteeredMarigoldPipeline, run: Callable[[], int]) -> Schedule:
    """Runs once, with the calls of the pipeline's networks counted and timed.

    run: returns how many maps it steered.
    """
    with recorded_calls(pipeline) as calls:
        start = time.perf_counter()
        steered = run()
        end = time.perf_counter()
    first_step = next(i for i, call in enumerate(calls) if call.network == "unet")
    last = max(i for i, call in enumerate(calls) if call.network == "decode")
    before, steps, after = calls[:first_step], calls[first_step:last], calls[last:]
    samples = _samples([*steps, *after])
    final = calls[last].samples
    return Schedule(
        image=sum(call.samples for call in before),
        unet=samples["unet"],
        decode=samples["decode"],
        encode=samples["encode"],
        final=final,
        approximate_decode=steered - (samples["decode"] - final),
        approximate_encode=steered - samples["encode"],
        before_s=calls[first_step].start - start - sum(call.seconds for call in before),
        loop_s=calls[last].start - steps[0].start - sum(call.seconds for call in steps),
        after_s=end - calls[last].end,
    )


def _samples(calls: list[Call]) -> dict[str, int]:
    names = ("unet", "decode", "encode")
    return {n: sum(call.samples for call in calls if call.network == n) for n in names}


@contextmanager
def recorded_calls(pipeline: SteeredMarigoldPipeline) -> Iterator[list[Call]]:
    """A list that grows with each call of a network of the pipeline."""
    networks = [(pipeline.unet, "forward", "unet")]
    networks += [(pipeline.vae, "decode", "decode"), (pipeline.vae, "encode", "encode")]
    if pipeline.image_encoder is not None:
        networks.append((pipeline.image_encoder, "forward", "image"))
    calls: list[Call] = []
    for module, method, name in networks:
        setattr(module, method, _recording(getattr(module, method), name, calls))
    try:
        yield calls
    finally:
        for module, method, _ in networks:
            delattr(module, method)


def _recording(method: Callable[..., Any], network: str, calls: list[Call]) -> Callable[..., Any]:
    def recorded(batch: Any, *args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        output = method(batch, *args, **kwargs)
        calls.append(Call(network, len(batch), start, time.perf_counter()))
        return output

    return recorded
