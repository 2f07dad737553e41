"""Your own method in the tables: a `DepthCompleter` of twenty lines.

    python -m examples.own_method FRAMES OUTPUT

FRAMES holds rgb/ and depth/. OUTPUT/table.md then compares it with linear interpolation and the
preset `fast`, each frame with the same measurements and with intervals of the differences.
"""

import sys
from pathlib import Path

import torch

from steered_marigold import DepthCompleter, DepthCompletion, Frame, create_method
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.report import write_outputs
from steered_marigold.evaluation.runner import run_evaluation
from steered_marigold.evaluation.settings import RunSettings


class RowMedian(DepthCompleter):
    """Gives each row the median of what was measured in it; rows without any, that of all."""

    name = "row-median"

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        measured = torch.where(frame.valid_mask, frame.sparse_depth, torch.nan)
        row = measured.nanmedian(dim=1, keepdim=True).values
        row = torch.where(row.isnan(), measured.nanmedian(), row)
        depth = torch.where(frame.valid_mask, frame.sparse_depth, row)
        valid = frame.valid_mask[None]
        return DepthCompletion(depth=depth[None], measured=valid, trusted=valid)


def create(name: str) -> DepthCompleter:
    """A method by its name in the tables."""
    return RowMedian() if name == RowMedian.name else create_method(name)


def main(frames: Path, output: Path, *, others: tuple[str, ...] = ("linear", "fast")) -> str:
    """Compares on every frame with a region of the measured area hidden; returns the table."""
    settings = RunSettings(
        dataset="folder",
        path=frames,
        protocol=Protocol(kind="region"),
        methods=(RowMedian.name, *others),
        frames=tuple(sorted(path.stem for path in (frames / "rgb").iterdir())),
    )
    write_outputs(run_evaluation(settings, output, create=create), output, create=create)
    return (output / "table.md").read_text(encoding="utf-8")


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2])))
