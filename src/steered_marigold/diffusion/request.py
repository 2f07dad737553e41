"""A call of the pipeline, checked: after this nothing of it can fail, and no network has run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.steering import Steering
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.grid import Measured, Views
from steered_marigold.diffusion.linear_codec import LinearCodec
from steered_marigold.diffusion.randomness import Generators, fork_generators
from steered_marigold.diffusion.settings import Preset
from steered_marigold.errors import InputError

CallbackOnStepEnd = Callable[[Any, int, Tensor, dict[str, Any]], dict[str, Any]]
CALLBACK_TENSORS = ("latents", "predicted_x0", "steering_target")
OUTPUT_TYPES = ("pt", "np")


@dataclass(frozen=True, kw_only=True)
class Request:
    """What one call is to do; the fields are those of `SteeredMarigoldPipeline.__call__`.

    confidence: [images, height, width]. share: of the scheduler's steps that are run, the last
    ones. steering_codec: what decodes and encodes in the steps of steering.
    """

    settings: Preset
    steps: int
    share: float
    views: Views
    measured: Measured | None
    confidence: Tensor | None
    sensor_noise: SensorNoise
    steering_codec: DepthCodec | LinearCodec
    generator: Generators
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


def require_output_type(output_type: str) -> None:
    """InputError for a form of the answer that there is not."""
    if output_type not in OUTPUT_TYPES:
        raise InputError(f"`output_type` is {output_type!r}: choose 'pt' or 'np'")


def require_callback_inputs(names: Sequence[str]) -> None:
    """InputError for tensors that a callback cannot have."""
    unknown = sorted(set(names) - set(CALLBACK_TENSORS))
    if unknown:
        raise InputError(
            f"`callback_on_step_end_tensor_inputs` has {unknown}; "
            f"known are {list(CALLBACK_TENSORS)}"
        )


def require_steps(steps: int, scheduler: Any) -> None:
    """InputError for a number of steps that the scheduler's schedule does not have."""
    most = int(scheduler.config.num_train_timesteps)
    if not 1 <= steps <= most:
        raise InputError(f"`num_inference_steps` is {steps}: choose 1 to {most}")


def require_shape(shape: tuple[int, ...], **tensors: Tensor | None) -> None:
    """InputError for a tensor that is given and has another shape."""
    for name, tensor in tensors.items():
        if tensor is not None and tuple(tensor.shape) != shape:
            raise InputError(f"`{name}` is {list(tensor.shape)}, but must be {list(shape)}")
