"""The frames of a video, one after another, each starting from the one before."""

from typing import Any

import torch
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter


class StreamingCompleter(DepthCompleter):
    """Completes a video frame by frame, with fewer steps and less flicker than frame by frame.

    The first frame starts from noise and runs all steps. Each later one starts from the depth
    latents of the frame before it, partly noised, and runs the last `restart` of the steps; the
    noise is that of the first frame. Where the same pixels were measured, steering reuses their
    triangulation. `reset` forgets the past, as a frame of another size does: call it at a cut.
    """

    def __init__(self, completer: SteeredCompleter, *, restart: float = 0.5) -> None:
        """completer: of at least two steps, or nothing is left of the frame before.

        Raises InputError for one of a single step.
        """
        if completer.num_inference_steps < 2:
            raise InputError(
                "a stream needs a completer of at least two steps: `num_inference_steps=2`"
            )
        self.name, self.steers = f"stream:{completer.name}", completer.steers
        self.completer, self.restart = completer, restart
        self.reset()

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        preset: str = "fast",
        num_inference_steps: int = 2,
        restart: float = 0.5,
        **arguments: Any,
    ) -> "StreamingCompleter":
        """As `SteeredCompleter.from_checkpoint`, whose further arguments it takes."""
        completer = SteeredCompleter.from_checkpoint(
            checkpoint, preset=preset, num_inference_steps=num_inference_steps, **arguments
        )
        return cls(completer, restart=restart)

    def reset(self) -> None:
        """The next frame starts anew."""
        self._latents: Tensor | None = None
        self._size: tuple[int, int] | None = None
        self._noise: Tensor | None = None

    def describe(self) -> dict[str, Any]:
        return self.completer.describe() | super().describe() | {"restart": self.restart}

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        """The next frame; the generator's state counts at the first one alone."""
        if self._size != frame.size:
            self.reset()
        if self._noise is None:
            self._noise = generator.get_state()
        generator.set_state(self._noise)
        answer = self.completer.run(
            frame,
            generator,
            previous_latents=self._latents,
            restart=self.restart,
            output_latents=True,
        )
        self._latents, self._size = answer.latents, frame.size
        return answer
