"""`SteeredMarigold`: a call from its check to its answer, whoever loaded the networks."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion, join_completions
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import finish, without_measurements
from steered_marigold.core.steering import ConditionAlignment
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.denoising import last_timesteps
from steered_marigold.diffusion.grid import Views, inner_part, pad, to_longer_side
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators
from steered_marigold.diffusion.request import (
    CallbackOnStepEnd,
    Request,
    check_call,
    require_output_type,
)
from steered_marigold.diffusion.sampling import Sample, sample_latents
from steered_marigold.diffusion.settings import (
    KNOBS,
    Preset,
    SamplingKnobs,
    SteeringCodec,
    get_preset,
)
from steered_marigold.errors import InputError


class SteeredMarigold(ABC):
    """Dense metric depth from an image and incomplete measurements (SteeredMarigold, ICRA 2025).

    A call is checked (`check_call`), then has three acts: it reads the images (`read`), samples
    depth latents (`sample_latents`), and makes metric depth of them (`_answer`).

    A subclass has the networks and the scheduler; its attributes are those of diffusers' pipelines.
    """

    unet: Any
    vae: Any
    image_encoder: Any
    steering_vae: Any
    config: Any
    vae_scale_factor: int
    default_denoising_steps: int
    default_processing_resolution: int
    device: torch.device
    dtype: torch.dtype
    # where the networks run, which offloading moves from `device`
    _execution_device: torch.device
    progress_bar: Callable[..., Any]
    set_progress_bar_config: Callable[..., None]
    maybe_free_model_hooks: Callable[[], None]

    @abstractmethod
    def load_images(self, image: Any) -> Float[Tensor, "images 3 height width"]:
        """The images of a call, in [0, 1], where the networks run; InputError for what is none."""

    @abstractmethod
    def predictor(
        self, image_latents: Tensor, prompt_tokens: int | None = None
    ) -> Callable[[Tensor, Tensor], Tensor]:
        """The U-Net as a function of (latents [batch, 4, h, w], timestep), the empty prompt given.

        image_latents: [batch, channels, h, w]. prompt_tokens: the prompt's padded length; None
        does not pad it.
        """

    @abstractmethod
    def local_scheduler(self, asked: tuple[str | None, Mapping[str, Any]] | None) -> Any:
        """The scheduler that a preset asks for (`Preset.scheduler`)."""

    @torch.no_grad()
    def __call__(
        self,
        image: Any,
        sparse_depth: Any = None,
        valid_mask: Any = None,
        *,
        preset: str | Preset | None = "default",
        num_inference_steps: int | None = None,
        steering_strength: float | None = None,
        neighborhood_px: int | None = None,
        anchor_fraction: float | None = None,
        anchors: Literal["fixed", "redraw"] | None = None,
        max_anchors: int | None = None,
        condition_alignment: ConditionAlignment | None = None,
        steering_codec: SteeringCodec | None = None,
        ensemble_size: int | None = None,
        mirror: bool | None = None,
        continuation: bool | None = None,
        processing_resolution: int | None = None,
        robust: bool | None = None,
        consistent: bool | None = None,
        sensor_noise: SensorNoise | None = None,
        confidence: Any = None,
        generator: Generators = None,
        latents: Tensor | None = None,
        previous_latents: Tensor | None = None,
        restart: float = 0.5,
        callback_on_step_end: CallbackOnStepEnd | None = None,
        callback_on_step_end_tensor_inputs: Sequence[str] = ("latents",),
        output_type: str = "pt",
        output_latents: bool = False,
        return_dict: bool = True,
    ) -> Any:
        """Completes the depth of one image or a batch of images of one size.

        image: whatever `MarigoldDepthPipeline` takes. sparse_depth: [m], [height, width] or
        [batch, height, width], at the image's size, of any kind of array; None for plain Marigold
        (`metric` is then False). valid_mask: where it was measured; None: where it is finite and
        positive.
        preset: a name of `PRESETS`, a `Preset`, or None for the pipeline as it is. The knobs, from
        num_inference_steps to consistent, win over it; `diffusion.settings` says what each does.
        sensor_noise: how closely measurements are met, with `consistent`; None is exactly.
        confidence: in [0, 1], weights the measurements. generator: one, or one for each image.
        latents: noise [batch * ensemble_size, 4, h, w], instead of drawing it.
        previous_latents: clean depth latents of that shape, as of the last frame of a video; then
        only the last `restart` of the steps is run, from there.
        callback_on_step_end(pipe, step, timestep, tensors): may return {"latents": ...}.
        output_latents: the answer carries the clean depth latents.

        Returns a `DepthCompletion` on the pipeline's device; with output_type "np" a dictionary of
        its arrays; with return_dict=False the tuple (depth, uncertainty, affine_depth).
        Raises InputError, SizeMismatchError or NoMeasurementsError, before any network runs, for
        input that does not fit.
        """
        knobs = {name: value for name, value in locals().items() if name in KNOBS}
        require_output_type(output_type)
        request = check_call(
            self,
            get_preset(preset).override(**knobs),
            image,
            (sparse_depth, valid_mask, confidence),
            sensor_noise=sensor_noise or SensorNoise(),
            share=1.0 if previous_latents is None else restart,
            generator=generator,
            latents=latents,
            previous_latents=previous_latents,
            callback=callback_on_step_end,
            callback_inputs=callback_on_step_end_tensor_inputs,
        )
        samples = sample_latents(self, request, self.read(request.views))
        answer = self._answer(request, samples)
        if output_latents:
            answer = replace(answer, latents=samples[-1].clean)
        self.maybe_free_model_hooks()
        return _output(answer, output_type, return_dict)

    def view(self, images: Float[Tensor, "images 3 height width"], knobs: SamplingKnobs) -> Views:
        """Images in [0, 1] on the processing grid; no network runs.

        Raises InputError for images that are too thin.
        """
        size = images.shape[-2], images.shape[-1]
        pixels = to_longer_side(images * 2.0 - 1.0, self.resolution(knobs))
        mirrored = knobs.mirror and knobs.ensemble_size % 2 == 0
        if mirrored:
            pixels = torch.stack([pixels, pixels.flip(-1)], dim=1).flatten(0, 1)
        pixels, padding = pad(pixels, self.vae_scale_factor)
        members = knobs.ensemble_size // (2 if mirrored else 1)
        return Views(pixels, padding, size, members, mirrored)

    def read(self, views: Views) -> Float[Tensor, "answers channels h w"]:
        """The image latents that the U-Net gets for every answer."""
        encode = self.image_encoder or DepthCodec(self.vae).encode_image
        latents: Tensor = encode(views.pixels.to(self.dtype))
        return latents.repeat_interleave(views.members, dim=0)

    def resolution(self, knobs: SamplingKnobs) -> int:
        """Longer side of the processing grid [px], with what the knobs leave to the checkpoint."""
        resolution = knobs.processing_resolution
        if resolution is None or (resolution == 0 and self.image_encoder is not None):
            return int(self.default_processing_resolution)
        return resolution

    def schedule(self, settings: Preset, steps: int, share: float = 1.0) -> tuple[Any, Tensor]:
        """A scheduler at the beginning of the last `share` of its timesteps, and those.

        It is a local one if the preset asks for other settings. Raises InputError for steps that
        it cannot take.
        """
        scheduler = self.local_scheduler(settings.scheduler)
        try:
            scheduler.set_timesteps(steps, device=self._execution_device)
        except ValueError as error:
            raise InputError(f"`num_inference_steps` is {steps}: {error}") from error
        return scheduler, last_timesteps(scheduler, share)

    def _answer(self, request: Request, samples: Sequence[Sample]) -> DepthCompletion:
        """The members of every pass, as one metric depth map for each image."""
        views, measured = request.views, request.measured
        passes = [
            views.upright(self.affine_depth(sample.decoded, views.padding, views.size))
            for sample in samples
        ]
        members_of_each = [torch.cat(members) for members in zip(*passes, strict=True)]
        if measured is None:
            return join_completions([without_measurements(m) for m in members_of_each])
        finishing, device = request.settings.finish, self._execution_device
        colour = request.images if finishing.consistent else None
        answers = [
            finish(
                members,
                measured.sparse_depth[i].to(device),
                measured.valid_mask[i].to(device),
                finishing,
                noise=request.sensor_noise,
                confidence=None if request.confidence is None else request.confidence[i].to(device),
                image=None if colour is None else colour[i],
            )
            for i, members in enumerate(members_of_each)
        ]
        answer = join_completions(answers)
        if not request.steers:
            return answer
        codec, steps = request.steering_codec, max(1, round(request.share * request.steps))
        linear = codec.linear_steps if isinstance(codec, LinearCodec) else 0
        return replace(answer, exact_codec_steps=steps - linear, linear_codec_steps=linear)

    def affine_depth(
        self, decoded: Tensor, padding: tuple[int, int], size: tuple[int, int]
    ) -> Tensor:
        """Decoded depth [batch, h, w] in [-1, 1] to [0, 1] at the input's size, without padding.

        padding: (rows, columns) [px] that `view` added. size: (height, width) of the answer.
        """
        affine = (decoded[:, None].float() + 1.0) / 2.0
        return F.interpolate(inner_part(affine, padding), size, mode="bilinear")[:, 0]


def _output(answer: DepthCompletion, output_type: str, return_dict: bool) -> Any:
    """The answer in the form that the caller asked for."""
    if output_type == "pt" and return_dict:
        return answer
    values: dict[str, Any] = dict(vars(answer))
    if output_type == "np":
        values = {k: v.cpu().numpy() if torch.is_tensor(v) else v for k, v in values.items()}
    if return_dict:
        return values
    return values["depth"], values["uncertainty"], values["affine_depth"]
