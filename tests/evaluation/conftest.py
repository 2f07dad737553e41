"""A small data set and runs on it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method

FRAMES = ("f0", "f1", "f2", "f3")


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> RunSettings:
    """Four frames of 40x32 px, tilted planes with steps; nearest and linear on 8 scan lines."""
    path = tmp_path_factory.mktemp("tiny")
    rng = np.random.default_rng(0)
    (path / "rgb").mkdir()
    (path / "depth").mkdir()
    rows, columns = np.mgrid[:32, :40]
    for frame in FRAMES:
        image = rng.integers(0, 256, (32, 40, 3), dtype=np.uint8)
        Image.fromarray(image).save(path / "rgb" / f"{frame}.png")
        tilt = rng.uniform(5, 40, 2)
        depth = 1500 + tilt[0] * rows + tilt[1] * columns + 700 * (columns > rng.integers(10, 30))
        Image.fromarray(depth.astype(np.uint16)).save(path / "depth" / f"{frame}.png")
    return RunSettings(
        dataset="folder",
        path=path,
        protocol=Protocol(kind="lidar", lines=8),
        methods=("nearest", "linear"),
        frames=FRAMES,
    )


class Wrapped(DepthCompleter):
    """`nearest`, with an uncertainty, and failing on frames whose image has a given first byte."""

    name = "wrapped"

    def __init__(self, fails_on: int | None = None) -> None:
        self.fails_on = fails_on
        self.draws: list[float] = []

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        if int(frame.image[0, 0, 0]) == self.fails_on:
            raise RuntimeError("out of ideas")
        self.draws.append(float(torch.rand((), generator=generator)))
        answer = create_method("nearest").answer(frame)
        trusted = answer.measured.clone()
        trusted[0, :16] = False
        return replace(answer, uncertainty=torch.full_like(answer.depth, 0.02), trusted=trusted)


@pytest.fixture
def failing_on() -> Callable[[Path], Callable[[str], DepthCompleter]]:
    """A factory whose method "wrapped" fails on one image."""

    def factory(image: Path) -> Callable[[str], DepthCompleter]:
        with Image.open(image) as file:
            first_byte = int(np.asarray(file)[0, 0, 0])
        return lambda name: Wrapped(first_byte) if name == "wrapped" else create_method(name)

    return factory
