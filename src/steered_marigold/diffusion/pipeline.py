"""`SteeredMarigoldPipeline`: Marigold, steered by measured depth."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
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
from diffusers.utils.torch_utils import randn_tensor
from torch import Tensor
from transformers import CLIPTextModel, CLIPTokenizer

from steered_marigold.core.completion import DepthCompletion, join_completions
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.finishing import Finishing, finish, without_measurements
from steered_marigold.core.steering import ConditionAlignment, Steering
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.denoising import StepEnd, denoise, last_timesteps
from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.measurements import check_measurements, stack_maps
from steered_marigold.diffusion.presets import Preset, SteeringCodec, get_preset
from steered_marigold.diffusion.randomness import (
    Generators,
    fork_generators,
    generators_of_members,
)
from steered_marigold.diffusion.views import Views
from steered_marigold.errors import InputError

Maps = Tensor | Sequence[Tensor]
CallbackOnStepEnd = Callable[[Any, int, Tensor, dict[str, Any]], dict[str, Any]]


class SteeredMarigoldPipeline(MarigoldDepthPipeline):  # type: ignore[misc]
    """Dense metric depth from an image and incomplete measurements (SteeredMarigold, ICRA 2025).

    Takes every model from a Marigold depth checkpoint, plus two optional components:
    image_encoder stands in for the VAE on the image side of the U-Net; steering_vae, such as
    `AutoencoderTiny` of "madebyollin/taesd", for the VAE while steering with
    `steering_codec="tiny"`. The configuration `continues_known` says that the U-Net was trained on
    latents of which a part is clean.
    """

    model_cpu_offload_seq = "text_encoder->image_encoder->unet->steering_vae->vae"
    _optional_components = ["image_encoder", "steering_vae"]  # noqa: RUF012 (diffusers' own form)
    _callback_tensor_inputs = ["latents", "predicted_x0", "steering_target"]  # noqa: RUF012

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
        sparse_depth: Maps | None = None,
        valid_mask: Maps | None = None,
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
        confidence: Maps | None = None,
        generator: Generators = None,
        latents: Tensor | None = None,
        previous_latents: Tensor | None = None,
        restart: float = 0.5,
        callback_on_step_end: CallbackOnStepEnd | None = None,
        callback_on_step_end_tensor_inputs: Sequence[str] = ("latents",),
        output_type: str = "pt",
        return_dict: bool = True,
    ) -> Any:
        """Completes the depth of one image or a batch of images of one size.

        image: whatever `MarigoldDepthPipeline` takes. sparse_depth: [m], [height, width] or
        [batch, height, width], at the image's size; None for plain Marigold (`metric` is then
        False). valid_mask: where it was measured; None: where it is finite and positive.
        preset: "paper", "default", "fast", a `Preset`, or None for the pipeline as it is; explicit
        arguments win over it.
        steering_strength: lambda; 0 does not steer. neighborhood_px: zeta [px] and anchor_fraction:
        the share of all pixels drawn as anchors, both on the processing grid. anchors: drawn once,
        or anew in every step. max_anchors: thins the measurements that steer. steering_codec:
        "exact" steers through the VAE, "tiny" through `steering_vae`, "linear" through a linear map
        that is fitted and checked in the run.
        mirror: every other member of an even ensemble sees the image mirrored.
        continuation: denoise a second time, told the measured depth, and merge both answers; only
        with a checkpoint that `continues_known`.
        robust: fit so that wrong measurements hardly count, and leave them out. consistent: make
        the answer agree with the measurements. sensor_noise: how closely, with `consistent`; None
        is exactly.
        confidence: in [0, 1], weights the measurements. generator: one, or one for each image.
        latents: noise [batch * ensemble_size, 4, h, w], instead of drawing it.
        previous_latents: clean depth latents of that shape, as of the last frame of a video; then
        only the last `restart` of the steps is run, from there.
        callback_on_step_end(pipe, step, timestep, tensors): may return {"latents": ...}.

        Returns a `DepthCompletion` on the pipeline's device; with output_type "np" a dictionary of
        its arrays; with return_dict=False the tuple (depth, uncertainty, affine_depth).
        Raises InputError, SizeMismatchError or NoMeasurementsError for input that does not fit.
        """
        settings = get_preset(preset).override(
            num_inference_steps=num_inference_steps,
            steering_strength=steering_strength,
            neighborhood_px=neighborhood_px,
            anchor_fraction=anchor_fraction,
            anchors=anchors,
            max_anchors=max_anchors,
            condition_alignment=condition_alignment,
            steering_codec=steering_codec,
            ensemble_size=ensemble_size,
            mirror=mirror,
            continuation=continuation,
            processing_resolution=processing_resolution,
            robust=robust,
            consistent=consistent,
        )
        device, members = self._execution_device, settings.ensemble_size
        steps, resolution = self._checkpoint_defaults(settings)
        images = self._check(image, steps, members, resolution, generator)
        views = self._views(image, resolution, settings)
        measured = None
        if sparse_depth is not None:
            measured = check_measurements(sparse_depth, valid_mask, images, views.size)
        codec = DepthCodec(self.vae)
        encode = codec.encode_image if self.image_encoder is None else self.image_encoder
        image_latents = encode(views.pixels.to(self.dtype)).repeat_interleave(views.members, dim=0)
        noise = generators_of_members(generator, images, members)
        shape = (len(image_latents), codec.channels, *image_latents.shape[-2:])
        _require_shape(shape, latents=latents, previous_latents=previous_latents)
        if latents is None:
            latents = randn_tensor(shape, noise, device=device, dtype=self.dtype)
        latents = latents.to(device, self.dtype)
        share = 1.0 if previous_latents is None else restart
        scheduler, timesteps = self._schedule(settings, steps, share)
        if previous_latents is not None:
            previous = previous_latents.to(device, self.dtype)
            latents = scheduler.add_noise(previous, latents, timesteps[:1])
        predict = self.predictor(image_latents, settings.prompt_tokens)
        steering, shortcut = None, self._shortcut(settings.steering_codec, codec)
        if measured is not None and settings.steering_strength != 0:
            forks = fork_generators(generator, images)
            steering = _steering(settings, views.on_grid(*measured), views.of_each(forks), device)
        known = measured if settings.continuation and self.config.continues_known else None
        calls = len(timesteps) * (1 if known is None else 2)
        with self._step_end(callback_on_step_end, callback_on_step_end_tensor_inputs, calls) as end:
            sample = partial(denoise, predict, generator=noise, step_end=end)
            clean = sample(
                scheduler,
                timesteps,
                shortcut,
                latents,
                steering=steering,
                steering_strength=settings.steering_strength,
            )
            estimates = [codec.decode(clean)]
            if known is not None:
                told = views.tell(known, estimates[0], codec)
                again = self._schedule(settings, steps, share)
                estimates.append(codec.decode(sample(*again, codec, latents, told=told)))
        passes = [
            views.upright(self.affine_depth(decoded, views.padding, views.size))
            for decoded in estimates
        ]
        members_of_each = [torch.cat(members) for members in zip(*passes, strict=True)]
        answer = self._finish(
            members_of_each, image, measured, confidence, sensor_noise, settings.finishing
        )
        if steering is not None:
            linear = shortcut.linear_steps if isinstance(shortcut, LinearCodec) else 0
            exact = len(timesteps) - linear
            answer = replace(answer, exact_codec_steps=exact, linear_codec_steps=linear)
        self.maybe_free_model_hooks()
        return _output(answer, output_type, return_dict)

    def _finish(
        self,
        members_of_each: list[Tensor],
        image: Any,
        measured: tuple[Tensor, Tensor] | None,
        confidence: Maps | None,
        sensor_noise: SensorNoise | None,
        finishing: Finishing,
    ) -> DepthCompletion:
        """The answers of the ensemble's members [members, height, width] for each image, as one."""
        if measured is None:
            return join_completions([without_measurements(m) for m in members_of_each])
        device = self._execution_device
        maps = None if confidence is None else stack_maps(confidence).float().to(device)
        colour = self._colour(image) if finishing.consistent else None
        answers = [
            finish(
                members,
                measured[0][i].to(device),
                measured[1][i].to(device),
                finishing,
                noise=sensor_noise or SensorNoise(),
                confidence=None if maps is None else maps[i],
                image=None if colour is None else colour[i],
            )
            for i, members in enumerate(members_of_each)
        ]
        return join_completions(answers)

    def _views(self, image: Any, resolution: int, settings: Preset) -> Views:
        """The images on the processing grid."""
        # in float32: antialiased resizing knows no half precision on CPUs
        pixels, padding, size = self.image_processor.preprocess(
            image, resolution, "bilinear", self._execution_device, torch.float32
        )
        mirrored = settings.mirror and settings.ensemble_size % 2 == 0
        if mirrored:
            inner = self.image_processor.unpad_image(pixels, padding).flip(-1)
            flipped, _ = self.image_processor.pad_image(inner, self.vae_scale_factor)
            pixels = torch.stack([pixels, flipped], dim=1).flatten(0, 1)
        members = settings.ensemble_size // (2 if mirrored else 1)
        return Views(pixels, tuple(padding), tuple(size), members, mirrored)

    def _checkpoint_defaults(self, settings: Preset) -> tuple[int, int]:
        """(steps, processing resolution) with what the preset leaves to the checkpoint."""
        steps = settings.num_inference_steps or self.default_denoising_steps
        resolution = settings.processing_resolution
        if resolution is None or (resolution == 0 and self.image_encoder is not None):
            resolution = self.default_processing_resolution
        return steps, resolution

    def _check(
        self, image: Any, steps: int, members: int, resolution: int, generator: Generators
    ) -> int:
        """The number of images; stock Marigold's checks, as errors of this package."""
        members = 1 if members == 2 else members  # stock Marigold warns of a pair
        try:
            images: int = self.check_inputs(
                image, steps, members, resolution, "bilinear", "bilinear", 1,
                None, None, None, "pt", False,
            )  # fmt: skip
        except ValueError as error:
            raise InputError(str(error)) from error
        if isinstance(generator, list) and len(generator) != images:
            raise InputError(
                f"generator is a list of {len(generator)} for {images} images: give one an image"
            )
        return images

    def _schedule(self, settings: Preset, steps: int, share: float) -> tuple[Any, Tensor]:
        """A scheduler at the beginning of the last `share` of its timesteps, and those.

        It is a local one if the preset asks for other settings.
        """
        scheduler = self.scheduler
        if settings.scheduler is not None:
            name, changes = settings.scheduler
            kind = type(scheduler) if name is None else getattr(diffusers, name)
            scheduler = kind.from_config(scheduler.config, **changes)
        scheduler.set_timesteps(steps, device=self._execution_device)
        return scheduler, last_timesteps(scheduler, share)

    def _shortcut(self, kind: SteeringCodec, exact: DepthCodec) -> DepthCodec | LinearCodec:
        """What decodes and encodes in the steps of steering."""
        if kind == "linear":
            return LinearCodec(exact)
        if kind == "exact":
            return exact
        if self.steering_vae is None:
            raise InputError("steering_codec='tiny' needs a checkpoint with a steering_vae")
        return DepthCodec(self.steering_vae)

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

    @contextmanager
    def _step_end(
        self, callback: CallbackOnStepEnd | None, inputs: Sequence[str], calls: int
    ) -> Iterator[StepEnd]:
        """What happens after each of so many steps: progress, and the caller's callback."""
        unknown = set(inputs) - set(self._callback_tensor_inputs)
        if unknown:
            raise InputError(
                f"callback_on_step_end_tensor_inputs has {sorted(unknown)}; "
                f"known are {self._callback_tensor_inputs}"
            )
        with self.progress_bar(total=calls) as progress:

            def step_end(i: int, t: Tensor, tensors: dict[str, Tensor | None]) -> Tensor:
                progress.update()
                latents = tensors["latents"]
                if callback is not None:
                    changed = callback(self, i, t, {name: tensors[name] for name in inputs})
                    latents = (changed or {}).get("latents", latents)
                assert latents is not None
                return latents

            yield step_end

    def affine_depth(
        self, decoded: Tensor, padding: tuple[int, int], size: tuple[int, int]
    ) -> Tensor:
        """Decoded depth [batch, h, w] in [-1, 1] to [0, 1] at the input's size, without padding.

        padding: (rows, columns) [px] that `image_processor.preprocess` added. size: (height,
        width) of the answer.
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


def _steering(
    settings: Preset,
    measured: tuple[Tensor, Tensor],
    generators: list[torch.Generator],
    device: torch.device,
) -> Steering:
    return Steering(
        *measured,
        neighborhood_px=settings.neighborhood_px,
        anchor_fraction=settings.anchor_fraction,
        redraw=settings.anchors == "redraw",
        max_anchors=settings.max_anchors,
        condition_alignment=settings.condition_alignment,
        generators=generators,
        device=device,
    )


def _require_shape(shape: tuple[int, ...], **tensors: Tensor | None) -> None:
    """InputError for a tensor that is given and has another shape."""
    for name, tensor in tensors.items():
        if tensor is not None and tuple(tensor.shape) != shape:
            raise InputError(f"{name} is {list(tensor.shape)}, but must be {list(shape)}")


def _output(answer: DepthCompletion, output_type: str, return_dict: bool) -> Any:
    """The answer in the form that the caller asked for."""
    if output_type not in ("pt", "np"):
        raise InputError(f"output_type is {output_type!r}: choose 'pt' or 'np'")
    if output_type == "pt" and return_dict:
        return answer
    values: dict[str, Any] = dict(vars(answer))
    if output_type == "np":
        values = {k: v.cpu().numpy() if torch.is_tensor(v) else v for k, v in values.items()}
    if return_dict:
        return values
    return values["depth"], values["uncertainty"], values["affine_depth"]
