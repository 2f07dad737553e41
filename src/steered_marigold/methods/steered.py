"""Steered and unsteered Marigold as completers of single frames."""

from typing import Any

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.steering import ConditionAlignment
from steered_marigold.diffusion.checkpoints import load_pipeline
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.diffusion.presets import SteeringCodec, get_preset
from steered_marigold.errors import InputError
from steered_marigold.methods.protocol import check_frame


class SteeredCompleter:
    """SteeredMarigold with a preset; arguments that are not None win over it.

    checkpoint, preset, num_inference_steps, device and dtype say what runs.
    """

    def __init__(
        self,
        pipeline: SteeredMarigoldPipeline,
        checkpoint: str,
        *,
        preset: str | None,
        sensor_noise: SensorNoise | None = None,
        progress: bool = False,
        **arguments: Any,
    ) -> None:
        self.name = f"steered:{preset}" if preset else "marigold"
        self.pipeline = pipeline
        self.checkpoint, self.preset = checkpoint, preset or "none"
        self._arguments = {"preset": preset, "sensor_noise": sensor_noise, **arguments}
        steps = arguments.get("num_inference_steps") or get_preset(preset).num_inference_steps
        self.num_inference_steps: int = steps or pipeline.default_denoising_steps
        pipeline.set_progress_bar_config(disable=not progress, leave=False)

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        preset: str = "default",
        device: str | None = None,
        dtype: torch.dtype | str | None = None,
        compiled: bool = False,
        num_inference_steps: int | None = None,
        steering_strength: float | None = None,
        condition_alignment: ConditionAlignment | None = None,
        steering_codec: SteeringCodec | None = None,
        ensemble_size: int | None = None,
        mirror: bool | None = None,
        continuation: bool | None = None,
        processing_resolution: int | None = None,
        robust: bool | None = None,
        consistent: bool | None = None,
        sensor_noise: SensorNoise | None = None,
        progress: bool = False,
    ) -> "SteeredCompleter":
        """Loads a checkpoint (see `load_pipeline`).

        dtype: None is "auto", what the device is fastest in, but float32 for preset "paper".

        Raises CheckpointError, or InputError for an unknown preset, device or dtype.
        """
        get_preset(preset)
        dtype = dtype or ("float32" if preset == "paper" else "auto")
        return cls(
            load_pipeline(checkpoint, device=device, dtype=_parse_dtype(dtype), compiled=compiled),
            checkpoint,
            preset=preset,
            num_inference_steps=num_inference_steps,
            steering_strength=steering_strength,
            condition_alignment=condition_alignment,
            steering_codec=steering_codec,
            ensemble_size=ensemble_size,
            mirror=mirror,
            continuation=continuation,
            processing_resolution=processing_resolution,
            robust=robust,
            consistent=consistent,
            sensor_noise=sensor_noise,
            progress=progress,
        )

    @property
    def device(self) -> torch.device:
        """Where the models are."""
        device: torch.device = self.pipeline.device
        return device

    @property
    def dtype(self) -> torch.dtype:
        """The models' precision."""
        dtype: torch.dtype = self.pipeline.dtype
        return dtype

    def complete(
        self,
        image: UInt8[Tensor, "height width 3"],
        sparse_depth: Float[Tensor, "height width"],
        valid_mask: Bool[Tensor, "height width"],
        K: Float[Tensor, "3 3"] | None = None,
        *,
        confidence: Float[Tensor, "height width"] | None = None,
        no_measurements: bool = False,
        generator: torch.Generator | None = None,
        **call: Any,
    ) -> DepthCompletion:
        """See `DepthCompleter.complete`.

        confidence: in [0, 1], the weight of each measurement. no_measurements: where valid_mask
        is False everywhere, answer with relative depth instead of raising. call: more arguments
        of the pipeline's call.
        """
        if not no_measurements:
            check_frame(self.name, image, sparse_depth, valid_mask)
        measured = bool(valid_mask.any())
        answer: DepthCompletion = self.pipeline(
            image.permute(2, 0, 1).float() / 255,
            sparse_depth if measured else None,
            valid_mask if measured else None,
            confidence=confidence,
            generator=generator,
            **self._arguments,
            **call,
        )
        return answer


class MarigoldCompleter(SteeredCompleter):
    """The checkpoint unsteered, scale and shift fitted by least squares: Marigold + M."""

    @classmethod
    def from_checkpoint(  # type: ignore[override]
        cls,
        checkpoint: str = "embedded",
        *,
        device: str | None = None,
        dtype: torch.dtype | str | None = None,
        num_inference_steps: int | None = None,
        ensemble_size: int | None = None,
        processing_resolution: int | None = None,
    ) -> "SteeredCompleter":
        """Loads a checkpoint; steps and resolution are its own unless given."""
        return cls(
            load_pipeline(checkpoint, device=device, dtype=_parse_dtype(dtype)),
            checkpoint,
            preset=None,
            num_inference_steps=num_inference_steps,
            ensemble_size=ensemble_size,
            processing_resolution=processing_resolution,
        )


def _parse_dtype(dtype: torch.dtype | str | None) -> torch.dtype | None:
    """What `load_pipeline` takes; None is float32."""
    if isinstance(dtype, torch.dtype):
        return dtype
    known = {
        "auto": None,
        "float32": torch.float32,
        "bfloat16": torch.bfloat16,
        "float16": torch.float16,
    }
    if dtype is not None and dtype not in known:
        raise InputError(f"dtype is {dtype!r}: choose one of {', '.join(known)}")
    return known[dtype or "float32"]
