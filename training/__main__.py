"""The recipe of the embedded checkpoint: `python -m training STAGE`, see docs/training.md.

Data comes from `python -m training.rooms --output ROOMS --frames 9000`.
"""

import warnings
from pathlib import Path
from typing import Annotated

import typer

from training import codec, denoiser, image_branch
from training.export import export

CHECKPOINT = Path(__file__).parents[1] / "src" / "steered_marigold" / "assets" / "checkpoint"

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
Runs = Annotated[Path, typer.Option(help="Folder of logs and weights; a stage resumes from it.")]
Rooms = Annotated[Path | None, typer.Option(help="Folder of procedural shards.")]
Nyuv2 = Annotated[Path | None, typer.Option(help="NYUv2 folder; without it rooms alone.")]
Minutes = Annotated[float, typer.Option(help="How long to train.")]


@app.command("image-branch")
def _image_branch(
    runs: Runs, rooms: Rooms = None, nyuv2: Nyuv2 = None, minutes: Minutes = 60
) -> None:
    """Stage 1: the image encoder as a regressor."""
    image_branch.train(nyuv2, rooms, runs / "image_branch", minutes=minutes)


@app.command("codec")
def _codec(runs: Runs, rooms: Rooms = None, nyuv2: Nyuv2 = None, minutes: Minutes = 40) -> None:
    """Stage 2: depth to latents and back; independent of stage 1."""
    codec.train(nyuv2, rooms, runs / "codec", minutes=minutes)


@app.command("denoiser")
def _denoiser(runs: Runs, rooms: Rooms = None, nyuv2: Nyuv2 = None, minutes: Minutes = 60) -> None:
    """Stage 3: the U-Net on the frozen results of stages 1 and 2."""
    denoiser.train(nyuv2, rooms, runs, minutes=minutes)


@app.command("export")
def _export(runs: Runs, to: Path = CHECKPOINT) -> None:
    """Stage 4: the checkpoint that the package ships."""
    export(runs, to)


if __name__ == "__main__":
    warnings.filterwarnings("ignore", category=FutureWarning)
    app()
