"""What workers of other processes do in tests; importable by them."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import CheckpointError
from tests.frames.completers import NearestCompleter


def load() -> NearestCompleter:
    """A completer that needs no checkpoint."""
    return NearestCompleter()


def squaring() -> Callable[[int], int]:
    """Squares; -1 ends the process as the kernel does when memory is short."""

    def work(number: int) -> int:
        if number == -1:
            os.kill(os.getpid(), signal.SIGKILL)
        return number * number

    return work


def lost(number: int, reason: str) -> str:
    """The result of a number that took its process down."""
    return f"{number}: {reason}"


def failing() -> Callable[[int], int]:
    """Cannot start."""
    raise CheckpointError("no such checkpoint")


def dying() -> Callable[[int], int]:
    """Dies before it is ready."""
    os._exit(3)


class LoadsOneToBeKilled:
    """Loads a completer that kills its process at one frame, once."""

    def __init__(self, frame_id: str, mark: Path) -> None:
        self.frame_id, self.mark = frame_id, mark

    def __call__(self) -> "KilledCompleter":
        return KilledCompleter(self.frame_id, self.mark)


class KilledCompleter(NearestCompleter):
    """See `LoadsOneToBeKilled`."""

    def __init__(self, frame_id: str, mark: Path) -> None:
        super().__init__()
        self.frame_id, self.mark = frame_id, mark

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        if frame.id == self.frame_id and not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super()._complete(frame, generator)
