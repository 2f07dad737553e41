"""What the approximate codec costs in quality on a full checkpoint: for whoever has its weights.

    python -m benchmarks.quality_full_size FRAMES --device cuda --output OUT

FRAMES holds rgb/ and depth/, one file a frame, paired by name, at least 608x448.
"""

from pathlib import Path
from typing import Annotated

import typer

from steered_marigold.datasets.dataset import select_frames
from steered_marigold.datasets.registry import open_dataset
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.report import write_outputs
from steered_marigold.evaluation.runner import run_evaluation
from steered_marigold.evaluation.settings import RunSettings

METHODS = (
    "linear",
    "marigold",
    "paper",
    "paper@steering_codec=linear",
    "default",
    "default@steering_strength=0.3",
    "default@steering_strength=0.3,steering_codec=exact",
    "fast",
)
PROTOCOLS = ("paper-uniform", "paper-erased")


def main(
    frames: Annotated[Path, typer.Argument(help="Folder with rgb/ and depth/.")],
    *,
    output: Annotated[Path, typer.Option(help="Folder of the runs; a stopped one goes on.")],
    checkpoint: Annotated[
        str, typer.Option(help="A folder or a hub id in Marigold's format.")
    ] = "prs-eth/marigold-depth-v1-1",
    device: Annotated[str, typer.Option(help="cpu, cuda, mps.")] = "cpu",
    dtype: Annotated[str, typer.Option(help="float32, bfloat16 or float16.")] = "float32",
    depth_scale: Annotated[
        float | None, typer.Option(help="Metres per unit; 0.001 for integers, 1 for floats.")
    ] = None,
    limit: Annotated[int | None, typer.Option(help="So many frames, evenly spaced.")] = None,
    seed: Annotated[int, typer.Option(help="Of the samples and of the methods.")] = 0,
) -> None:
    """Both of the paper's protocols on a folder of frames; prints the tables."""
    dataset = open_dataset("folder", frames, depth_scale=depth_scale)
    for kind in PROTOCOLS:
        settings = RunSettings(
            dataset="folder",
            path=frames.resolve(),
            depth_scale=depth_scale,
            protocol=Protocol(kind=kind),
            methods=METHODS,
            frames=select_frames(dataset, limit=limit),
            seed=seed,
            checkpoint=checkpoint,
            device=device,
            dtype=dtype,
        )
        run = run_evaluation(settings, output / kind, warn=print)
        write_outputs(run, output / kind)
        print(f"## {kind}\n\n{(output / kind / 'table.md').read_text(encoding='utf-8')}")
        if run.failures:
            raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
