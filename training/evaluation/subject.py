"""The checkpoint that is evaluated, and the frames that it is evaluated on."""

import hashlib
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from steered_marigold.diffusion.checkpoints import load_pipeline
from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.evaluation.protocols import PreparedFrame, Protocol
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.evaluation.settings import RunSettings
from training.data import Frame, depth_range, image_to_model, normalise, read_split, resized

SEED = 0
Row = dict[str, Any]
Tables = dict[str, list[Row]]


@dataclass(frozen=True)
class Findings:
    """What a part of the evaluation found: tables by title, and the pictures it drew."""

    tables: Tables
    pictures: tuple[str, ...] = ()


@dataclass(frozen=True)
class NativeFrame:
    """The 608x448 crop of a frame at the training size, as the training stages see it.

    image: RGB in -1..1 [1, 3, 240, 320]. normalised: the true depth [1, 240, 320] with its 2 % and
    98 % percentiles, `low` and `high` [m], at -1 and 1, clipped.
    """

    image: Tensor
    normalised: Tensor
    low: float
    high: float

    def errors(self, decoded: Tensor, mask: Tensor | None = None) -> Row:
        """Mean errors of a decoded map [1, 240, 320] in [-1, 1] over a mask of its shape.

        abs_error: of the normalised depth, in units of [-1, 1]. abs_rel: after this frame's own
        normalisation is undone for both; what was clipped is nobody's error.
        """
        error, half_range = (decoded - self.normalised).abs(), (self.high - self.low) / 2
        truth = self.low + (self.normalised + 1) * half_range
        maps = {"abs_error": error, "abs_rel": error * half_range / truth}
        return {k: float((x if mask is None else x[mask]).mean()) for k, x in maps.items()}


@dataclass(frozen=True, kw_only=True)
class Subject:
    """checkpoint: see `load_pipeline`. nyuv2: the folder of frames. frames: their ids.

    steps: numbers of steps, ascending; the last is that of steering. samples: how many are drawn
    of each frame. output: the folder of results. real_frames: folders of sensor frames. rgbd: the
    folder of RGB-D pairs of other sources, of which `split`, at most `limit` of a kind, are taken.
    """

    checkpoint: str
    nyuv2: Path
    frames: tuple[str, ...]
    steps: tuple[int, ...]
    samples: int
    output: Path
    real_frames: Path | None = None
    rgbd: Path | None = None
    split: str = "report"
    limit: int | None = None

    @cached_property
    def pipeline(self) -> SteeredMarigoldPipeline:
        """The pipeline, in float32, without progress bars."""
        pipeline = load_pipeline(self.checkpoint, device="cpu")
        pipeline.set_progress_bar_config(disable=True)
        return pipeline

    @cached_property
    def codec(self) -> DepthCodec:
        """The pipeline's codec."""
        return DepthCodec(self.pipeline.vae)

    @cached_property
    def scheduler(self) -> Any:
        """A copy of the pipeline's scheduler that may be asked for any timestep."""
        scheduler = deepcopy(self.pipeline.scheduler)
        scheduler.set_timesteps(50)
        return scheduler

    def image_latents(self, frame: NativeFrame) -> Tensor:
        """What the U-Net sees of the image."""
        encoder = self.pipeline.image_encoder
        latents: Tensor = (self.codec.encode_image if encoder is None else encoder)(frame.image)
        return latents

    def estimate(self, latents: Tensor, timestep: int, image_latents: Tensor) -> Tensor:
        """Decoded x0 [1, height, width] as predicted from latents at a timestep."""
        t = torch.tensor(timestep)
        output = self.pipeline.predictor(image_latents)(latents, t)
        step = self.scheduler.step(output, t, latents, generator=torch.Generator())
        return self.codec.decode(step.pred_original_sample)

    def run(self, kind: str, methods: tuple[str, ...] = ()) -> RunSettings:
        """A run of methods on the frames under a protocol of the paper."""
        return self.run_on(self.nyuv2, Protocol(kind=kind), methods, self.frames)

    def run_on(
        self, folder: Path, protocol: Protocol, methods: tuple[str, ...], frames: tuple[str, ...]
    ) -> RunSettings:
        """A run of methods on the frames of any folder under any protocol."""
        return RunSettings(
            dataset="folder",
            path=folder,
            protocol=protocol,
            methods=methods,
            frames=frames,
            seed=SEED,
            checkpoint=self.checkpoint,
        )

    def prepared(self, kind: str, frame_id: str) -> PreparedFrame:
        """A frame as methods see it under a protocol of the paper."""
        return Evaluator(self.run(kind)).prepare(frame_id)

    def native(self, frame_id: str) -> NativeFrame:
        """A frame at the training size."""
        frame = self.prepared("paper-uniform", frame_id)
        millimetres = (frame.metric_depth * 1000).round().numpy().astype(np.uint16)
        small = resized(Frame(frame.shown.image.numpy(), millimetres))
        metres = small.depth.astype(np.float32) / 1000
        low, high = depth_range(metres)
        image = torch.from_numpy(small.image.transpose(2, 0, 1).copy())[None]
        normalised = torch.from_numpy(normalise(metres))[None]
        return NativeFrame(image_to_model(image), normalised, low, high)

    def weights(self) -> str:
        """SHA-256 of all the weights as they are in memory."""
        digest = hashlib.sha256()
        for name, part in sorted(self.pipeline.components.items()):
            if isinstance(part, torch.nn.Module):
                for key, value in sorted(part.state_dict().items()):
                    digest.update(f"{name}.{key}".encode())
                    digest.update(value.contiguous().numpy().tobytes())
        return digest.hexdigest()


def evenly_spaced(items: list[str] | tuple[str, ...], count: int | None) -> tuple[str, ...]:
    """`count` of the items from the first to the last; all if None or more than there are."""
    if count is None or count >= len(items):
        return tuple(items)
    chosen = np.linspace(0, len(items) - 1, count).round().astype(int)
    return tuple(items[i] for i in chosen)


def split_frames(split: str, limit: int | None) -> tuple[str, ...]:
    """Frame ids of "report" or "tune", at most `limit`, evenly spaced."""
    return evenly_spaced([f"{index:04d}" for index in read_split(split)], limit)


def mean_row(rows: list[Row]) -> Row:
    """The mean of each value over rows with the same keys."""
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
