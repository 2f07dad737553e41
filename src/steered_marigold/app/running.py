"""Completion for the page: models that are loaded once, runs that can be watched and stopped."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Event, Lock
from typing import Any

import torch
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.diffusion.checkpoints import default_device, load_marigold, parse_dtype
from steered_marigold.diffusion.marigold import SteeredMarigold
from steered_marigold.diffusion.settings import get_preset
from steered_marigold.errors import SteeredMarigoldError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.steering_steps import StepRecorder

OnStep = Callable[[int, int], None]  # so many steps are done, of so many


class StoppedError(SteeredMarigoldError):
    """A run was ended before its answer."""


@dataclass(kw_only=True)
class Watch:
    """Over one run: tells of its steps, and ends it when asked to or when it takes too long.

    stop: set from another thread. longest_s: seconds from now on.
    """

    on_step: OnStep
    stop: Event
    longest_s: float
    begun: float = field(default_factory=time.monotonic)

    def step(self, done: int, total: int) -> None:
        """Raises StoppedError if the run is to end."""
        if self.stop.is_set():
            raise StoppedError("Cancelled.")
        if time.monotonic() - self.begun > self.longest_s:
            raise StoppedError(
                f"Stopped after {self.longest_s:.0f} s, the longest that a run may take on this "
                "page; the command `steered-marigold complete` has no such limit."
            )
        self.on_step(done, total)


class WatchedCompleter(DepthCompleter):
    """A completer under a watch. recorder: keeps every step."""

    answers_without_measurements = True

    def __init__(
        self, completer: SteeredCompleter, watch: Watch, recorder: StepRecorder | None = None
    ) -> None:
        self.name, self.steers = completer.name, completer.steers
        self.completer, self.watch, self.recorder = completer, watch, recorder

    def describe(self) -> dict[str, Any]:
        return self.completer.describe()

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        total, done = self.completer.count_steps(frame), 0
        self.watch.step(done, total)

        def step_end(
            pipe: Any, step: int, timestep: Tensor, tensors: dict[str, Any]
        ) -> dict[str, Any]:
            nonlocal done
            done += 1
            self.watch.step(done, total)
            return {} if self.recorder is None else self.recorder(pipe, step, timestep, tensors)

        return self.completer.run(
            frame,
            generator,
            callback_on_step_end=step_end,
            callback_on_step_end_tensor_inputs=StepRecorder.tensor_inputs,
        )


class Models:
    """The checkpoints that the page offers, by the name that it shows; loaded when first used."""

    def __init__(self, checkpoints: Mapping[str, str], *, device: str | None = None) -> None:
        self.checkpoints = dict(checkpoints)
        self._device = default_device() if device is None else torch.device(device)
        self._pipelines: dict[tuple[str, torch.dtype], SteeredMarigold] = {}
        self._lock = Lock()

    def completer(self, name: str, *, preset: str, **knobs: Any) -> SteeredCompleter:
        """Raises CheckpointError if the checkpoint cannot be loaded, InputError for bad knobs."""
        checkpoint = self.checkpoints[name]
        dtype = parse_dtype(get_preset(preset).dtype, self._device)
        with self._lock:
            if (checkpoint, dtype) not in self._pipelines:
                self._pipelines[checkpoint, dtype] = load_marigold(
                    checkpoint, device=self._device, dtype=dtype
                )
            pipeline = self._pipelines[checkpoint, dtype]
        return SteeredCompleter(pipeline, checkpoint, preset=preset, **knobs)
