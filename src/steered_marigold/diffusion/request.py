"""A call of the pipeline, checked: after this nothing of it can fail, and no network has run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from torch import Tensor

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.steering import Steering
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.denoising import require_clean_estimate
from steered_marigold.diffusion.grid import Measured, Views, stack_confidence, stack_measured
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators, fork_generators
from steered_marigold.diffusion.settings import Preset, SamplingKnobs, SteeringCodec
from steered_marigold.errors import InputError

if TYPE_CHECKING:
    from steered_marigold.diffusion.marigold import SteeredMarigold

CallbackOnStepEnd = Callable[[Any, int, Tensor, dict[str, Any]], dict[str, Any]]
CALLBACK_TENSORS = ("latents", "predicted_x0", "steering_target")
OUTPUT_TYPES = ("pt", "np")


@dataclass(frozen=True, kw_only=True)
class Request:
    """What one call is to do; the fields are those of `SteeredMarigoldPipeline.__call__`.

    images: [images, 3, height, width], in [0, 1]. confidence: [images, height, width]. share: of
    the scheduler's steps that are run, the last ones. steering_codec: what decodes and encodes in
    the steps of steering.
    """

    settings: Preset
    steps: int
    share: float
    images: Tensor
    views: Views
    measured: Measured | None
    confidence: Tensor | None
    sensor_noise: SensorNoise
    steering_codec: DepthCodec | LinearCodec
    generator: Generators
    latents_shape: tuple[int, ...]
    latents: Tensor | None
    previous_latents: Tensor | None
    callback: CallbackOnStepEnd | None
    callback_inputs: Sequence[str]

    @property
    def steers(self) -> bool:
        """Whether there is anything to steer towards, and a wish to."""
        return self.measured is not None and self.settings.steering.steering_strength != 0

    def steering(self, device: Any) -> Steering | None:
        """The measurements, ready to move predictions towards."""
        if self.measured is None or not self.steers:
            return None
        knobs, on_grid = self.settings.steering, self.views.on_grid(self.measured)
        return Steering(
            on_grid.sparse_depth,
            on_grid.valid_mask,
            neighborhood_px=knobs.neighborhood_px,
            anchor_fraction=knobs.anchor_fraction,
            redraw=knobs.anchors == "redraw",
            max_anchors=knobs.max_anchors,
            condition_alignment=knobs.condition_alignment,
            generators=self.views.of_each(fork_generators(self.generator, self.views.images)),
            device=device,
        )


def check_call(
    pipe: "SteeredMarigold",
    settings: Preset,
    image: Any,
    maps: tuple[Any, Any, Any],
    *,
    latents: Tensor | None,
    previous_latents: Tensor | None,
    share: float,
    generator: Generators,
    **rest: Any,
) -> Request:
    """The call as a request. maps: sparse depth, valid mask and confidence, as given.

    Raises InputError, SizeMismatchError or NoMeasurementsError; no network runs.
    """
    knobs = settings.sampling
    steps = knobs.num_inference_steps
    steps = pipe.default_denoising_steps if steps is None else steps
    scheduler = pipe.local_scheduler(settings.scheduler)
    require_clean_estimate(scheduler)
    _require_steps(steps, scheduler)
    pipe.schedule(settings, steps, share)
    _require_callback_inputs(rest["callback_inputs"])
    codec = _steering_codec(pipe, settings.steering.steering_codec)
    _require_sizes(pipe, knobs)
    pixels = pipe.load_images(image)
    images = len(pixels)
    if isinstance(generator, list) and len(generator) != images:
        raise InputError(
            f"`generator` is a list of {len(generator)} for {images} images: give one an image"
        )
    views = pipe.view(pixels, knobs)
    grid = [side // pipe.vae_scale_factor for side in views.pixels.shape[-2:]]
    shape = (views.answers, pipe.vae.config.latent_channels, *grid)
    _require_shape(shape, latents=latents, previous_latents=previous_latents)
    depth, mask, weights = maps
    return Request(
        settings=settings,
        steps=steps,
        share=share,
        images=pixels,
        views=views,
        measured=None if depth is None else stack_measured(depth, mask, images, views.size),
        confidence=None if weights is None else stack_confidence(weights, images, views.size),
        steering_codec=codec,
        generator=generator,
        latents_shape=shape,
        latents=latents,
        previous_latents=previous_latents,
        **rest,
    )


def require_output_type(output_type: str) -> None:
    """InputError for a form of the answer that there is not."""
    if output_type not in OUTPUT_TYPES:
        raise InputError(f"`output_type` is {output_type!r}: choose 'pt' or 'np'")


def _require_sizes(pipe: "SteeredMarigold", knobs: SamplingKnobs) -> None:
    """InputError for an ensemble or a processing grid that there cannot be."""
    if knobs.ensemble_size < 1:
        raise InputError(f"`ensemble_size` is {knobs.ensemble_size}: it must be at least 1")
    resolution = pipe.resolution(knobs)
    if resolution < 0 or resolution % pipe.vae_scale_factor:
        raise InputError(
            f"`processing_resolution` is {resolution}: choose a multiple of "
            f"{pipe.vae_scale_factor}, or 0 for the image's own size"
        )


def _steering_codec(pipe: "SteeredMarigold", kind: SteeringCodec) -> DepthCodec | LinearCodec:
    if kind != "tiny":
        exact = DepthCodec(pipe.vae)
        return LinearCodec(exact) if kind == "linear" else exact
    if pipe.steering_vae is None:
        raise InputError("`steering_codec='tiny'` needs a checkpoint with a steering_vae")
    return DepthCodec(pipe.steering_vae)


def _require_callback_inputs(names: Sequence[str]) -> None:
    """InputError for tensors that a callback cannot have."""
    unknown = sorted(set(names) - set(CALLBACK_TENSORS))
    if unknown:
        raise InputError(
            f"`callback_on_step_end_tensor_inputs` has {unknown}; "
            f"known are {list(CALLBACK_TENSORS)}"
        )


def _require_steps(steps: int, scheduler: Any) -> None:
    """InputError for a number of steps that the scheduler's schedule does not have."""
    most = int(scheduler.config.num_train_timesteps)
    if not 1 <= steps <= most:
        raise InputError(f"`num_inference_steps` is {steps}: choose 1 to {most}")


def _require_shape(shape: tuple[int, ...], **tensors: Tensor | None) -> None:
    """InputError for a tensor that is given and has another shape."""
    for name, tensor in tensors.items():
        if tensor is not None and tuple(tensor.shape) != shape:
            raise InputError(f"`{name}` is {list(tensor.shape)}, but must be {list(shape)}")
