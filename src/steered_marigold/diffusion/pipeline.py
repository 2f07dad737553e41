"""`SteeredMarigoldPipeline`: Marigold, steered by measured depth."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
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
from steered_marigold.diffusion.continuation import tell
from steered_marigold.diffusion.denoising import (
    StepEnd,
    denoise,
    last_timesteps,
    require_clean_estimate,
)
from steered_marigold.diffusion.grid import Views, stack_confidence, stack_measured
from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators, draw_noise, generators_of_members
from steered_marigold.diffusion.request import (
    CALLBACK_TENSORS,
    CallbackOnStepEnd,
    Request,
    require_callback_inputs,
    require_output_type,
    require_shape,
    require_steps,
)
from steered_marigold.diffusion.settings import (
    KNOBS,
    Preset,
    SamplingKnobs,
    SteeringCodec,
    get_preset,
)
from steered_marigold.errors import InputError


@dataclass(frozen=True)
class Sample:
    """What one pass gave for every answer: clean depth latents, and depth on the grid, -1 to 1."""

    clean: Float[Tensor, "answers channels h w"]
    decoded: Float[Tensor, "answers height width"]


class SteeredMarigoldPipeline(MarigoldDepthPipeline):  # type: ignore[misc]
    """Dense metric depth from an image and incomplete measurements (SteeredMarigold, ICRA 2025).

    Takes every model from a Marigold depth checkpoint, plus two optional components:
    image_encoder stands in for the VAE on the image side of the U-Net; steering_vae, such as
    `AutoencoderTiny` of "madebyollin/taesd", for the VAE while steering with
    `steering_codec="tiny"`. The configuration `continues_known` says that the U-Net was trained on
    latents of which a part is clean.

    A call has three acts: it reads the images (`view`, `read`), samples depth latents, and makes
    metric depth of them.
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
        request = self._check(
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
        samples = self._sample(request, self.read(request.views))
        answer = self._answer(request, samples, image)
        if output_latents:
            answer = replace(answer, latents=samples[-1].clean)
        self.maybe_free_model_hooks()
        return _output(answer, output_type, return_dict)

    # act one: read

    def view(self, image: Any, knobs: SamplingKnobs) -> Views:
        """The images on the processing grid; no network runs."""
        resolution = self._resolution(knobs)
        # in float32: antialiased resizing knows no half precision on CPUs
        pixels, padding, size = self.image_processor.preprocess(
            image, resolution, "bilinear", self._execution_device, torch.float32
        )
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

    def _check(
        self,
        settings: Preset,
        image: Any,
        maps: tuple[Any, Any, Any],
        *,
        callback_inputs: Sequence[str],
        latents: Tensor | None,
        previous_latents: Tensor | None,
        share: float,
        **rest: Any,
    ) -> Request:
        """The call as a request. maps: sparse depth, valid mask and confidence, as given."""
        knobs = settings.sampling
        steps = knobs.num_inference_steps
        steps = self.default_denoising_steps if steps is None else steps
        scheduler = self._local_scheduler(settings.scheduler)
        require_clean_estimate(scheduler)
        require_steps(steps, scheduler)
        self.schedule(settings, steps, share)
        require_callback_inputs(callback_inputs)
        codec = self._steering_codec(settings.steering.steering_codec)
        images = self._count_images(image, knobs)
        generator = rest["generator"]
        if isinstance(generator, list) and len(generator) != images:
            raise InputError(
                f"`generator` is a list of {len(generator)} for {images} images: give one an image"
            )
        views = self.view(image, knobs)
        grid = [side // self.vae_scale_factor for side in views.pixels.shape[-2:]]
        shape = (views.answers, self.vae.config.latent_channels, *grid)
        require_shape(shape, latents=latents, previous_latents=previous_latents)
        depth, mask, confidence = maps
        measured = None if depth is None else stack_measured(depth, mask, images, views.size)
        return Request(
            settings=settings,
            steps=steps,
            share=share,
            views=views,
            measured=measured,
            confidence=None
            if confidence is None
            else stack_confidence(confidence, images, views.size),
            steering_codec=codec,
            latents=latents,
            previous_latents=previous_latents,
            callback_inputs=callback_inputs,
            **rest,
        )

    def _count_images(self, image: Any, knobs: SamplingKnobs) -> int:
        """How many there are, after stock Marigold's checks, as errors of this package."""
        members = 1 if knobs.ensemble_size == 2 else knobs.ensemble_size  # stock warns of a pair
        try:
            images: int = self.check_inputs(
                image, 1, members, self._resolution(knobs), "bilinear", "bilinear", 1,
                None, None, None, "pt", False,
            )  # fmt: skip
        except ValueError as error:
            raise InputError(str(error)) from error
        return images

    def _resolution(self, knobs: SamplingKnobs) -> int:
        """Of the processing grid, with what the knobs leave to the checkpoint."""
        resolution = knobs.processing_resolution
        if resolution is None or (resolution == 0 and self.image_encoder is not None):
            return int(self.default_processing_resolution)
        return resolution

    def _steering_codec(self, kind: SteeringCodec) -> DepthCodec | LinearCodec:
        if kind != "tiny":
            exact = DepthCodec(self.vae)
            return LinearCodec(exact) if kind == "linear" else exact
        if self.steering_vae is None:
            raise InputError("`steering_codec='tiny'` needs a checkpoint with a steering_vae")
        return DepthCodec(self.steering_vae)

    # act two: sample

    def _sample(self, request: Request, image_latents: Tensor) -> list[Sample]:
        """Depth latents by denoising; once more, told the first answer, where that is asked for."""
        views, settings, codec = request.views, request.settings, DepthCodec(self.vae)
        noise = generators_of_members(
            request.generator, views.images, settings.sampling.ensemble_size
        )
        scheduler, timesteps = self.schedule(settings, request.steps, request.share)
        latents = self._first_latents(request, image_latents, noise, scheduler, timesteps)
        continues = settings.sampling.continuation and self.config.continues_known
        known = request.measured if continues else None
        calls = len(timesteps) * (1 if known is None else 2)
        with self._step_end(request, calls) as step_end:
            run = partial(
                denoise,
                self.predictor(image_latents, settings.prompt_tokens),
                generator=noise,
                step_end=step_end,
            )
            clean = run(
                scheduler,
                timesteps,
                request.steering_codec,
                latents,
                steering=request.steering(self._execution_device),
                steering_strength=settings.steering.steering_strength,
            )
            samples = [Sample(clean, codec.decode(clean))]
            if known is not None:
                told = tell(views, known, samples[0].decoded, codec)
                again = self.schedule(settings, request.steps, request.share)
                clean = run(*again, codec, latents, told=told)
                samples.append(Sample(clean, codec.decode(clean)))
        return samples

    def _first_latents(
        self,
        request: Request,
        image_latents: Tensor,
        noise: Generators,
        scheduler: Any,
        timesteps: Tensor,
    ) -> Tensor:
        """Where denoising begins: noise, or the previous latents with as much of it as is left."""
        device = self._execution_device
        latents = request.latents
        if latents is None:
            channels = self.vae.config.latent_channels
            shape = (request.views.answers, channels, *image_latents.shape[-2:])
            latents = draw_noise(shape, noise, device=device, dtype=self.dtype)
        latents = latents.to(device, self.dtype)
        if request.previous_latents is None:
            return latents
        previous = request.previous_latents.to(device, self.dtype)
        noisy: Tensor = scheduler.add_noise(previous, latents, timesteps[:1])
        return noisy

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
        scheduler = self._local_scheduler(settings.scheduler)
        try:
            scheduler.set_timesteps(steps, device=self._execution_device)
        except ValueError as error:
            raise InputError(f"`num_inference_steps` is {steps}: {error}") from error
        return scheduler, last_timesteps(scheduler, share)

    def _local_scheduler(self, asked: tuple[str | None, Mapping[str, Any]] | None) -> Any:
        if asked is None:
            return self.scheduler
        name, changes = asked
        kind = type(self.scheduler) if name is None else getattr(diffusers, name)
        return kind.from_config(self.scheduler.config, **changes)

    @contextmanager
    def _step_end(self, request: Request, calls: int) -> Iterator[StepEnd]:
        """What happens after each of so many steps: progress, and the caller's callback."""
        with self.progress_bar(total=calls) as progress:

            def step_end(i: int, t: Tensor, tensors: dict[str, Tensor | None]) -> Tensor:
                progress.update()
                latents = tensors["latents"]
                if request.callback is not None:
                    shown = {name: tensors[name] for name in request.callback_inputs}
                    changed = request.callback(self, i, t, shown)
                    latents = (changed or {}).get("latents", latents)
                assert latents is not None
                return latents

            yield step_end

    # act three: answer

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
