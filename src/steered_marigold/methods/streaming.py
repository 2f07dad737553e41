"""The frames of a video, one after another, each starting from the one before."""

from typing import Any

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.methods.steered import SteeredCompleter


class StreamingCompleter:
    """Completes a video frame by frame, with fewer steps and less flicker than frame by frame.

    The first frame starts from noise and runs all steps. Each later one starts from the depth
    latents of the frame before it, partly noised, and runs the last `restart` of the steps; the
    noise is that of the first frame. Where the same pixels were measured, steering reuses their
    triangulation. `reset` forgets the past, as a frame of another size does: call it at a cut.
    """

    def __init__(self, completer: SteeredCompleter, *, restart: float = 0.5, seed: int = 0) -> None:
        """completer: of at least two steps, or nothing is left of the frame before."""
        self.completer, self.restart, self.seed = completer, restart, seed
        self._latents: Tensor | None = None
        self._size: torch.Size | None = None

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        preset: str = "fast",
        num_inference_steps: int = 2,
        restart: float = 0.5,
        seed: int = 0,
        **arguments: Any,
    ) -> "StreamingCompleter":
        """As `SteeredCompleter.from_checkpoint`, whose further arguments it takes."""
        completer = SteeredCompleter.from_checkpoint(
            checkpoint, preset=preset, num_inference_steps=num_inference_steps, **arguments
        )
        return cls(completer, restart=restart, seed=seed)

    def reset(self) -> None:
        """The next frame starts anew."""
        self._latents = None

    def complete(
        self,
        image: UInt8[Tensor, "height width 3"],
        sparse_depth: Float[Tensor, "height width"],
        valid_mask: Bool[Tensor, "height width"],
        K: Float[Tensor, "3 3"] | None = None,
        *,
        confidence: Float[Tensor, "height width"] | None = None,
    ) -> DepthCompletion:
        """The next frame; see `DepthCompleter.complete`."""
        if self._size != image.shape:
            self.reset()
        kept: dict[str, Tensor] = {}

        def keep(pipe: Any, i: int, t: Tensor, tensors: dict[str, Any]) -> dict[str, Any]:
            kept.update(tensors)
            return {}

        answer = self.completer.complete(
            image,
            sparse_depth,
            valid_mask,
            K,
            confidence=confidence,
            generator=torch.Generator().manual_seed(self.seed),
            previous_latents=self._latents,
            restart=self.restart,
            callback_on_step_end=keep,
        )
        self._latents, self._size = kept["latents"], image.shape
        return answer
