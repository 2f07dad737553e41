"""Marigold-DC: a Marigold checkpoint whose latent is optimised against the measurements."""

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.diffusion.checkpoints import default_device, load_marigold
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.diffusion.randomness import draw_noise
from steered_marigold.diffusion.settings import Preset, SamplingKnobs
from steered_marigold.errors import InputError
from steered_marigold.methods.completer import DepthCompleter

LATENT_LEARNING_RATE = 0.05
AFFINE_LEARNING_RATE = 0.005


class MarigoldDCCompleter(DepthCompleter):
    """Viola et al., "Marigold-DC: Zero-Shot Monocular Depth Completion with Guided Diffusion",
    ICCV 2025 (arXiv 2412.13389), with DDIM steps in trailing spacing.

    pipeline: around any Marigold checkpoint, in float32 or bfloat16. num_inference_steps: 50 as
    published. ensemble_size: runs from different noise; the answer is their pixel-wise median (the
    paper's best rows take 10). processing_resolution: longer side of the image that the model sees
    [px], 0 for the image's own; None is the checkpoint's (768 for Marigold's).

    With a single measured value the answer is constant: the range that the model's depth is mapped
    to is empty. Gradients keep the activations of U-Net and decoder: it needs several times the
    memory of Marigold.
    """

    name = "marigold-dc"

    def __init__(
        self,
        pipeline: SteeredMarigold,
        *,
        num_inference_steps: int = 50,
        ensemble_size: int = 1,
        processing_resolution: int | None = None,
    ) -> None:
        if num_inference_steps < 1 or ensemble_size < 1:
            raise InputError(
                f"num_inference_steps ({num_inference_steps}) and ensemble_size "
                f"({ensemble_size}) must be at least 1"
            )
        if pipeline.dtype == torch.float16:
            raise InputError("marigold-dc: gradients overflow in float16; use bfloat16 or float32")
        for model in (pipeline.unet, pipeline.vae):
            model.requires_grad_(False)
        self._pipeline = pipeline
        self._preset = Preset(
            sampling=SamplingKnobs(
                num_inference_steps=num_inference_steps, processing_resolution=processing_resolution
            ),
            scheduler=("DDIMScheduler", {"timestep_spacing": "trailing"}),
        )
        self._num_inference_steps, self._ensemble_size = num_inference_steps, ensemble_size

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        device: str | None = None,
        dtype: torch.dtype | None = None,
        num_inference_steps: int = 50,
        ensemble_size: int = 1,
        processing_resolution: int | None = None,
    ) -> "MarigoldDCCompleter":
        """Loads a checkpoint (see `load_marigold`); dtype None: bfloat16 on CUDA, else float32."""
        chosen = default_device() if device is None else torch.device(device)
        fitting = torch.bfloat16 if chosen.type == "cuda" else torch.float32
        pipeline = load_marigold(checkpoint, device=device, dtype=dtype or fitting)
        # the authors' program runs contiguous; channels-last moves 50 steps of Adam by up to 11 mm
        for model in filter(None, (pipeline.unet, pipeline.vae, pipeline.image_encoder)):
            model.to(memory_format=torch.contiguous_format)
        return cls(
            pipeline,
            num_inference_steps=num_inference_steps,
            ensemble_size=ensemble_size,
            processing_resolution=processing_resolution,
        )

    def describe(self) -> dict[str, Any]:
        pipe = self._pipeline
        dtype = str(pipe.dtype).removeprefix("torch.")
        return super().describe() | {
            "steps": self._num_inference_steps,
            "device": str(pipe.device),
            "dtype": dtype,
        }

    @torch.no_grad()
    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        pipe = self._pipeline
        device, dtype, codec = pipe.device, pipe.dtype, DepthCodec(pipe.vae)
        images = pipe.load_images(frame.image.permute(2, 0, 1).float() / 255)
        views = pipe.view(images, self._preset.sampling)
        image_latents = pipe.read(views)
        u_net = pipe.predictor(image_latents)
        scheduler, _ = pipe.schedule(self._preset, self._num_inference_steps)

        def predict(latents: Tensor, t: Tensor) -> Tensor:
            output: Tensor = u_net(latents.to(dtype), t)
            return output.float()

        def decode(latents: Tensor) -> Tensor:
            decoded = codec.decode(latents.to(dtype)).float()
            affine: Tensor = pipe.affine_depth(decoded, views.padding, views.size)
            return affine[0]

        # noise in the models' precision, so that a seed gives what it gives to Marigold
        shape = (1, codec.channels, *image_latents.shape[-2:])
        sparse, mask = frame.sparse_depth.to(device), frame.valid_mask.to(device)
        starts = [
            draw_noise(shape, generator, device=device, dtype=dtype).float()
            for _ in range(self._ensemble_size)
        ]
        members = [
            guided_denoising(predict, decode, scheduler, start, sparse, mask) for start in starts
        ]
        depth = torch.stack(members).median(dim=0).values.to(frame.sparse_depth)
        measured = frame.valid_mask[None]
        return DepthCompletion(depth=depth[None], measured=measured, trusted=measured)


class MetricMap:
    """Metric from affine-invariant depth with two learned numbers (the paper's scale and shift).

    metric = a^2 (far - near) affine + b^2 near, a = b = 1 at the start: the range of the
    measurements. Squares keep both factors positive.
    """

    def __init__(self, measured: Float[Tensor, " points"]) -> None:
        self._near, self._far = measured.min(), measured.max()
        self.a = torch.ones_like(self._near, requires_grad=True)
        self.b = torch.ones_like(self._near, requires_grad=True)

    def __call__(self, affine: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        return self.a**2 * (self._far - self._near) * affine + self.b**2 * self._near


@torch.enable_grad()
def guided_denoising(
    predict: Callable[[Tensor, Tensor], Tensor],
    decode: Callable[[Tensor], Tensor],
    scheduler: Any,
    latents: Float[Tensor, "1 channels h w"],
    sparse_depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> Float[Tensor, "height width"]:
    """One run of Marigold-DC.

    At every step the loss of the predicted clean depth at the measurements goes back through
    decoder and U-Net to the latent, to which Adam gives one update before the scheduler's step.

    predict: (latents, timestep) to the U-Net's output. decode: latents to affine-invariant depth
    at the size of sparse_depth [m]. scheduler: with its timesteps set. Returns metric depth [m].
    """
    measured = sparse_depth[valid_mask]
    to_metric = MetricMap(measured)
    latents = latents.detach().clone().requires_grad_()
    optimizer = torch.optim.Adam(
        [
            {"params": [latents], "lr": LATENT_LEARNING_RATE},
            {"params": [to_metric.a, to_metric.b], "lr": AFFINE_LEARNING_RATE},
        ]
    )
    for t in scheduler.timesteps:
        output = predict(latents, t)
        predicted_x0 = scheduler.step(output, t, latents)["pred_original_sample"]
        residual = to_metric(decode(predicted_x0))[valid_mask] - measured
        loss = residual.abs().mean() + residual.square().mean()
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        with torch.no_grad():
            alpha_bar = scheduler.alphas_cumprod[t].to(latents)
            epsilon = (latents - alpha_bar.sqrt() * predicted_x0) / (1 - alpha_bar).sqrt()
            assert latents.grad is not None
            # as long as the noise, whatever the depth's unit and the noise level
            latents.grad *= epsilon.norm() / latents.grad.norm().clamp(min=1e-8)
            optimizer.step()
            latents.copy_(scheduler.step(output, t, latents)["prev_sample"])
    return to_metric(decode(latents)).detach()
