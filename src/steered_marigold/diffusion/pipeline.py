"""`SteeredMarigoldPipeline`: Marigold, steered by measured depth."""

from collections.abc import Callable, Mapping
from typing import Any

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

from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.diffusion.request import CALLBACK_TENSORS
from steered_marigold.errors import InputError


class SteeredMarigoldPipeline(SteeredMarigold, MarigoldDepthPipeline):  # type: ignore[misc]
    """Dense metric depth from an image and incomplete measurements (SteeredMarigold, ICRA 2025).

    Takes every model from a Marigold depth checkpoint, plus two optional components:
    image_encoder stands in for the VAE on the image side of the U-Net; steering_vae, such as
    `AutoencoderTiny` of "madebyollin/taesd", for the VAE while steering with
    `steering_codec="tiny"`. The configuration `continues_known` says that the U-Net was trained on
    latents of which a part is clean.
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

    def load_images(self, image: Any) -> Float[Tensor, "images 3 height width"]:
        load, images = self.image_processor.load_image_canonical, []
        try:
            for one in image if isinstance(image, list) else [image]:
                # in float32: antialiased resizing knows no half precision on CPUs
                images.append(load(one, self._execution_device, torch.float32))
                self.image_processor.check_image_values_range(images[-1])
            return torch.cat(images)
        except (ValueError, RuntimeError) as error:
            raise InputError(f"`image` cannot be read: {error}") from error

    def predictor(
        self, image_latents: Tensor, prompt_tokens: int | None = None
    ) -> Callable[[Tensor, Tensor], Tensor]:
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

    def local_scheduler(self, asked: tuple[str | None, Mapping[str, Any]] | None) -> Any:
        if asked is None:
            return self.scheduler
        name, changes = asked
        kind = type(self.scheduler) if name is None else getattr(diffusers, name)
        return kind.from_config(self.scheduler.config, **changes)
