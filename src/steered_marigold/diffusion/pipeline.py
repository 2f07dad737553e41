"""`SteeredMarigoldPipeline`: Marigold, steered by measured depth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import diffusers
import torch
from diffusers import (
    AutoencoderKL,
    AutoencoderTiny,
    MarigoldDepthPipeline,
    UNet2DConditionModel,
)
from jaxtyping import Float
from torch import Tensor
from transformers import CLIPTextModel, CLIPTokenizer

from steered_marigold.core.completion import DepthCompletion, join_completions
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import finish, without_measurements
from steered_marigold.core.steering import ConditionAlignment
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.denoising import last_timesteps
from steered_marigold.diffusion.grid import Views
from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators
from steered_marigold.diffusion.request import (
    CALLBACK_TENSORS,
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


class SteeredMarigoldPipeline(MarigoldDepthPipeline):  # type: ignore[misc]
    """Dense metric depth from an image and incomplete measurements (SteeredMarigold, ICRA 2025).

    Takes every model from a Marigold depth checkpoint, plus two optional components:
    image_encoder stands in for the VAE on the image side of the U-Net; steering_vae, such as
    `AutoencoderTiny` of "madebyollin/taesd", for the VAE while steering with
    `steering_codec="tiny"`. The configuration `continues_known` says that the U-Net was trained on
    latents of which a part is clean.

    A call is checked (`check_call`), then has three acts: it reads the images (`read`), samples
    depth latents (`sample_latents`), and makes metric depth of them (`_answer`).
    """

    model_cpu_offload_seq = "text_encoder->image_encoder->unet->steering_vae->vae"
    _optional_components = ["image_encoder", "steering_vae"]  # noqa: RUF012 (diffusers' own form)
    _callback_tensor_inputs = list(CALLBACK_TENSORS)  # noqa: RUF012

    def __init__(
        self,
        unet: UNet2DConditionModel,
        vae: AutoencoderKL,
        scheduler: Any,
        text_encoder: CLIPTextModel,
        tokenizer: CLIPTokenizer,
        image_encoder: ImageEncoder | None = None,
        steering_vae: AutoencoderTiny | None = None,
        prediction_type: str | None = None,
        scale_invariant: bool | None = True,
        shift_invariant: bool | None = True,
        default_denoising_steps: int | None = None,
        default_processing_resolution: int | None = None,
        continues_known: bool = False,
    ) -> None:
        super().__init__(
            unet,
            vae,
            scheduler,
            text_encoder,
            tokenizer,
            prediction_type,
            scale_invariant,
            shift_invariant,
            default_denoising_steps,
            default_processing_resolution,
        )
        self.register_modules(image_encoder=image_encoder, steering_vae=steering_vae)
        self.register_to_config(continues_known=continues_known)
        self._text_embeddings: dict[int | None, Tensor] = {}

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
        answer = self._answer(request, samples, image)
        if output_latents:
            answer = replace(answer, latents=samples[-1].clean)
        self.maybe_free_model_hooks()
        return _output(answer, output_type, return_dict)

    def view(self, image: Any, knobs: SamplingKnobs) -> Views:
        """The images on the processing grid; no network runs. InputError for too thin ones."""
        resolution = self.resolution(knobs)
        try:
            # in float32: antialiased resizing knows no half precision on CPUs
            pixels, padding, size = self.image_processor.preprocess(
                image, resolution, "bilinear", self._execution_device, torch.float32
            )
        except ValueError as error:
            raise InputError(f"`image` cannot be brought to {resolution} px: {error}") from error
        mirrored = knobs.mirror and knobs.ensemble_size % 2 == 0
        if mirrored:
            inner = self.image_processor.unpad_image(pixels, padding).flip(-1)
            flipped, _ = self.image_processor.pad_image(inner, self.vae_scale_factor)
            pixels = torch.stack([pixels, flipped], dim=1).flatten(0, 1)
        members = knobs.ensemble_size // (2 if mirrored else 1)
        return Views(pixels, tuple(padding), tuple(size), members, mirrored)

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

    def predictor(
        self, image_latents: Tensor, prompt_tokens: int | None = None
    ) -> Callable[[Tensor, Tensor], Tensor]:
        """The U-Net as a function of (latents [batch, 4, h, w], timestep), the empty prompt given.

        image_latents: [batch, channels, h, w]. prompt_tokens: the prompt's padded length; None
        does not pad it.
        """
        text = self._empty_prompt(prompt_tokens).expand(len(image_latents), -1, -1)

        def predict(latents: Tensor, t: Tensor) -> Tensor:
            both = torch.cat([image_latents, latents], dim=1)
            output: Tensor = self.unet(both, t, encoder_hidden_states=text, return_dict=False)[0]
            return output

        return predict

    def _empty_prompt(self, tokens: int | None) -> Tensor:
        """The empty prompt's embedding [1, tokens, channels], computed once for each length."""
        if tokens not in self._text_embeddings:
            padding = "do_not_pad" if tokens is None else "max_length"
            ids = self.tokenizer(
                "",
                padding=padding,
                max_length=tokens or self.tokenizer.model_max_length,
                truncation=True,
                return_tensors="pt",
            ).input_ids
            self._text_embeddings[tokens] = self.text_encoder(ids.to(self._execution_device))[0]
        return self._text_embeddings[tokens].to(self._execution_device, self.dtype)

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

    def local_scheduler(self, asked: tuple[str | None, Mapping[str, Any]] | None) -> Any:
        if asked is None:
            return self.scheduler
        name, changes = asked
        kind = type(self.scheduler) if name is None else getattr(diffusers, name)
        return kind.from_config(self.scheduler.config, **changes)

    def _answer(self, request: Request, samples: Sequence[Sample], image: Any) -> DepthCompletion:
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
        colour = self._colour(image) if finishing.consistent else None
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
        affine = self.image_processor.unpad_image(affine, padding)
        resized: Tensor = self.image_processor.resize_antialias(affine, size, "bilinear", False)
        return resized[:, 0]

    def _colour(self, image: Any) -> Tensor:
        """The images as [batch, 3, height, width] in [0, 1]."""
        images = image if isinstance(image, list) else [image]
        load = self.image_processor.load_image_canonical
        return torch.cat([load(i, self._execution_device, torch.float32) for i in images])


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
