"""Write shards of random rooms, or a contact sheet of them.

python -m training.rooms --output DIR --frames 6000 --workers 2 --seed 0
python -m training.rooms --contact-sheet sheet.png
"""

import sys
from pathlib import Path
from typing import Annotated

import cv2
import matplotlib
import numpy as np
import typer

from training.rooms.render import render_room
from training.rooms.shards import write_shards


def main(
    output: Annotated[Path | None, typer.Option(help="folder for shards")] = None,
    contact_sheet: Annotated[Path | None, typer.Option(help="PNG of 12 frames")] = None,
    frames: Annotated[int, typer.Option(min=1, help="how many frames")] = 6000,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT")] = "320x240",
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="runs of different seeds share no room")] = 0,
) -> None:
    """Random rooms as training data."""
    width, height = (int(side) for side in size.split("x"))
    if output is not None:
        shards = write_shards(
            output, frames=frames, size=(width, height), workers=workers, seed=seed
        )
        for path in shards:
            print(path, flush=True)
    if contact_sheet is not None:
        write_contact_sheet(contact_sheet, first_seed=seed * 1_000_000)
        print(contact_sheet)
    if output is None and contact_sheet is None:
        sys.exit("nothing to do: give --output or --contact-sheet")


def write_contact_sheet(path: Path, *, first_seed: int) -> None:
    """Image and depth (0.5..8 m, logarithmic) side by side for 12 seeds."""
    colours = matplotlib.colormaps["turbo_r"]
    cells = []
    for seed in range(first_seed, first_seed + 12):
        frame = render_room(seed)
        scaled = np.log(np.clip(frame.depth, 0.5, 8) / 0.5) / np.log(16)
        depth = (colours(scaled)[..., :3] * 255).astype(np.uint8)
        cells.append(np.concatenate([frame.image, depth], axis=1))
    rows = [np.concatenate(cells[i : i + 3], axis=1) for i in range(0, 12, 3)]
    picture = np.concatenate(rows, axis=0)
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        sys.exit(f"cannot write {path}")


if __name__ == "__main__":
    typer.run(main)
