"""Your own data set in the tables: a class with `name`, `frame_ids` and `load`.

    python -m examples.own_dataset FOLDER OUTPUT

Here each frame is one .npz file with `image` (uint8 RGB), `lidar` and `depth` ([m], 0 = nothing).
Data that is already `rgb/`, `depth/` and `sparse/` needs no code:
`steered-marigold evaluate folder`.
"""

import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch

from steered_marigold import make_frame
from steered_marigold.datasets.dataset import Dataset
from steered_marigold.datasets.sample import Sample
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.report import write_outputs
from steered_marigold.evaluation.runner import run_evaluation
from steered_marigold.evaluation.settings import RunSettings


@dataclass(frozen=True)
class NpzFrames:
    """A folder of .npz files."""

    path: Path
    name: ClassVar[str] = "npz"

    @cached_property
    def frame_ids(self) -> tuple[str, ...]:
        return tuple(sorted(path.stem for path in self.path.glob("*.npz")))

    def load(self, frame_id: str) -> Sample:
        arrays = np.load(self.path / f"{frame_id}.npz")
        truth = torch.from_numpy(arrays["depth"].astype(np.float32))
        return Sample(
            frame=make_frame(arrays["image"], arrays["lidar"], id=frame_id),
            metric_depth=truth,
            metric_mask=truth > 0,
        )


class NpzSettings(RunSettings):
    """A run on such frames."""

    def open_dataset(self) -> Dataset:
        return NpzFrames(self.path)


def main(folder: Path, output: Path, *, methods: tuple[str, ...] = ("linear", "fast")) -> str:
    """Completes what the LiDAR measured and compares with the truth; returns the table."""
    settings = NpzSettings(
        dataset="npz",
        path=folder,
        protocol=Protocol(kind="given"),
        methods=methods,
        frames=NpzFrames(folder).frame_ids,
    )
    write_outputs(run_evaluation(settings, output), output)
    return (output / "table.md").read_text(encoding="utf-8")


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2])))
