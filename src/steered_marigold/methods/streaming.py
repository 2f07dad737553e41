"""The frames of a video, one after another, each knowing what the ones before it measured."""

from collections import Counter
from dataclasses import replace
from typing import Any

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.core.frame import Frame
from steered_marigold.core.memory import StreamMemory
from steered_marigold.io.odometry import MotionSource, find_warp
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter


class StreamingCompleter(DepthCompleter):
    """Completes a video with less error in its holes and less flicker than frame by frame.

    Measurements of earlier frames are moved along and stand in the holes of the present one, with a
    noise that grows with their age; the last answer is moved along too, and averaged with the
    present one where nothing is known (`core.memory`). How the camera moved is told by the frames'
    `pose`; without, it is estimated by RGB-D odometry if K is known, else pixels follow the optical
    flow. All frames draw from the same random numbers, those of the first one's generator. `reset`
    forgets the past, as a frame of another size does: call it at a cut.

    motions: how often each source told the motion from a frame to the next.
    """

    def __init__(
        self, completer: DepthCompleter, *, sensor_noise: SensorNoise | None = None
    ) -> None:
        """completer: of single frames, one that weighs confidence. sensor_noise: of the video."""
        self.name, self.steers = f"stream:{completer.name}", completer.steers
        self.completer = completer
        self.motions: Counter[MotionSource] = Counter()
        self._memory = StreamMemory(sensor_noise)
        self.reset()

    @classmethod
    def from_checkpoint(
        cls,
        checkpoint: str = "embedded",
        *,
        preset: str = "fast",
        sensor_noise: SensorNoise | None = None,
        **arguments: Any,
    ) -> "StreamingCompleter":
        """As `SteeredCompleter.from_checkpoint`, whose further arguments it takes."""
        completer = SteeredCompleter.from_checkpoint(
            checkpoint, preset=preset, sensor_noise=sensor_noise, **arguments
        )
        return cls(completer, sensor_noise=sensor_noise)

    def reset(self) -> None:
        """The next frame starts anew."""
        self._memory.reset()
        self._earlier: Frame | None = None
        self._noise: torch.Tensor | None = None

    def describe(self) -> dict[str, Any]:
        return self.completer.describe() | super().describe()

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        """The next frame; the generator's state counts at the first one alone."""
        if self._earlier is not None and self._earlier.size != frame.size:
            self.reset()
        if self._noise is None:
            self._noise = generator.get_state()
        generator.set_state(self._noise)
        warp = None
        if self._earlier is not None:
            found = find_warp(self._earlier, frame, motion=self._earlier.motion_to(frame))
            if found is not None:
                warp = found.warp
                self.motions[found.source] += 1
        recalled = self._memory.recall(frame, warp)
        answer = self.completer.answer(recalled.frame, generator=generator)
        answer = self._memory.settle(recalled.frame, answer, warp)
        self._earlier = frame
        given = frame.valid_mask[None].to(answer.measured.device)
        return replace(answer, measured=given, trusted=answer.trusted & given)
