"""Act two of a call: depth latents by denoising, and once more, told the first answer."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from jaxtyping import Float
from torch import Tensor

from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.continuation import tell
from steered_marigold.diffusion.denoising import StepEnd, denoise
from steered_marigold.diffusion.randomness import Generators, draw_noise, generators_of_members
from steered_marigold.diffusion.request import Request

if TYPE_CHECKING:
    from steered_marigold.diffusion.marigold import SteeredMarigold


@dataclass(frozen=True)
class Sample:
    """What one pass gave for every answer: clean depth latents, and depth on the grid, -1 to 1."""

    clean: Float[Tensor, "answers channels h w"]
    decoded: Float[Tensor, "answers height width"]


def sample_latents(
    pipe: "SteeredMarigold",
    request: Request,
    image_latents: Float[Tensor, "answers channels h w"],
) -> list[Sample]:
    """One sample, or two where the request continues what is known and the checkpoint can."""
    views, settings, codec = request.views, request.settings, DepthCodec(pipe.vae)
    noise = generators_of_members(request.generator, views.images, settings.sampling.ensemble_size)
    scheduler, timesteps = pipe.schedule(settings, request.steps, request.share)
    latents = _first_latents(pipe, request, noise, scheduler, timesteps)
    continues = settings.sampling.continuation and pipe.config.continues_known
    known = request.measured if continues else None
    calls = len(timesteps) * (1 if known is None else 2)
    with _step_end(pipe, request, calls) as step_end:
        predict = pipe.predictor(image_latents, settings.prompt_tokens)
        run = partial(denoise, predict, generator=noise, step_end=step_end)
        clean = run(
            scheduler,
            timesteps,
            request.steering_codec,
            latents,
            steering=request.steering(latents.device),
            steering_strength=settings.steering.steering_strength,
        )
        samples = [Sample(clean, codec.decode(clean))]
        if known is not None:
            told = tell(views, known, samples[0].decoded, codec)
            again = pipe.schedule(settings, request.steps, request.share)
            clean = run(*again, codec, latents, told=told)
            samples.append(Sample(clean, codec.decode(clean)))
    return samples


def _first_latents(
    pipe: "SteeredMarigold",
    request: Request,
    noise: Generators,
    scheduler: Any,
    timesteps: Tensor,
) -> Tensor:
    """Where denoising begins: noise, or the previous latents with as much of it as is left."""
    device, latents = request.views.pixels.device, request.latents
    if latents is None:
        latents = draw_noise(request.latents_shape, noise, device=device, dtype=pipe.dtype)
    latents = latents.to(device, pipe.dtype)
    if request.previous_latents is None:
        return latents
    previous = request.previous_latents.to(device, pipe.dtype)
    noisy: Tensor = scheduler.add_noise(previous, latents, timesteps[:1])
    return noisy


@contextmanager
def _step_end(pipe: "SteeredMarigold", request: Request, calls: int) -> Iterator[StepEnd]:
    """What happens after each of so many steps: progress, and the caller's callback."""
    with pipe.progress_bar(total=calls) as progress:

        def step_end(i: int, t: Tensor, tensors: dict[str, Tensor | None]) -> Tensor:
            progress.update()
            latents = tensors["latents"]
            if request.callback is not None:
                shown = {name: tensors[name] for name in request.callback_inputs}
                changed = request.callback(pipe, i, t, shown)
                latents = (changed or {}).get("latents", latents)
            assert latents is not None
            return latents

        yield step_end
