"""Steered and unsteered Marigold as completers of single frames."""

from typing import Any, ClassVar

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.frame import Frame
from steered_marigold.diffusion.checkpoints import load_marigold
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.diffusion.settings import KNOBS, get_preset, require_knobs
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.memory import available_memory, require_memory

PLAIN_NAME = "marigold"  # of the pipeline as it is, without a preset


class SteeredCompleter(DepthCompleter):
    """A Marigold-format checkpoint with a preset: SteeredMarigold and what goes beyond it.

    Its name is the preset's. preset None: the checkpoint unsteered, scale and shift fitted by least
    squares (Marigold + M). knobs, a field of the groups in `diffusion.settings` each, win over the
    preset where they are not None.
    """

    answers_without_measurements = True
    settings: ClassVar[dict[str, Any]] = KNOBS  # what `create_method` reads after @

    def __init__(
        self,
        pipeline: SteeredMarigold,
        checkpoint: str,
        *,
        preset: str | None,
        sensor_noise: SensorNoise | None = None,
        progress: bool = False,
        **knobs: Any,
    ) -> None:
        chosen = get_preset(preset).override(**knobs)
        self.name = preset or PLAIN_NAME
        self.pipeline, self.checkpoint = pipeline, checkpoint
        self.steers = chosen.steering.steering_strength != 0
        steps = chosen.sampling.num_inference_steps
        self.num_inference_steps: int = steps or pipeline.default_denoising_steps
        self._call: dict[str, Any] = {"preset": chosen, "sensor_noise": sensor_noise}
        pipeline.set_progress_bar_config(disable=not progress, leave=False)

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        preset: str | None = "default",
        device: str | None = None,
        dtype: torch.dtype | str | None = None,
        compiled: bool = False,
        sensor_noise: SensorNoise | None = None,
        progress: bool = False,
        **knobs: Any,
    ) -> "SteeredCompleter":
        """Loads a checkpoint (see `load_marigold`).

        dtype: None is the preset's own. knobs: see the class.

        Raises CheckpointError, or InputError for an unknown preset, knob, device or dtype.
        """
        require_knobs(knobs)
        dtype = dtype or get_preset(preset).dtype
        pipeline = load_marigold(checkpoint, device=device, dtype=dtype, compiled=compiled)
        return cls(
            pipeline,
            checkpoint,
            preset=preset,
            sensor_noise=sensor_noise,
            progress=progress,
            **knobs,
        )

    @property
    def device(self) -> torch.device:
        """Where the models are."""
        return self.pipeline.device

    @property
    def dtype(self) -> torch.dtype:
        """The models' precision."""
        return self.pipeline.dtype

    def count_steps(self, frame: Frame) -> int:
        """How many denoising steps the frame takes, with those of a second pass."""
        continues = self._call["preset"].sampling.continuation
        twice = continues and self.pipeline.config.continues_known and frame.measured
        return self.num_inference_steps * (2 if twice else 1)

    def describe(self) -> dict[str, Any]:
        return super().describe() | {
            "checkpoint": self.checkpoint,
            "preset": self.name,
            "steps": self.num_inference_steps,
            "device": str(self.device),
            "dtype": str(self.dtype).removeprefix("torch."),
        }

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        return self.run(frame, generator)

    def run(self, frame: Frame, generator: torch.Generator, **call: Any) -> DepthCompletion:
        """The pipeline's answer to a frame; call: more arguments of its call.

        Raises InputError if it does not fit into this machine's memory.
        """
        if self.device.type == "cpu":
            members = self._call["preset"].sampling.ensemble_size
            require_memory(frame.size, members, available=available_memory())
        answer: DepthCompletion = self.pipeline(
            frame.image.permute(2, 0, 1).float() / 255,
            frame.sparse_depth if frame.measured else None,
            frame.valid_mask if frame.measured else None,
            confidence=frame.confidence,
            generator=generator,
            **self._call | call,
        )
        return answer
