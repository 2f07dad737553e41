"""Random rooms on disk: shards for training, a contact sheet, the package's sample frames.

With --streets the same of streets; with --crops surfaces look like photographs.

python -m rooms --output DIR --frames 6000 --workers 2 --seed 0
python -m rooms --contact-sheet sheet.png
python -m rooms --sample src/steered_marigold/assets/sample
python -m rooms --sample src/steered_marigold/assets/samples/office --scene office
python -m rooms --sample src/steered_marigold/assets/samples/chair --scene chair
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import cv2
import matplotlib
import numpy as np
import typer

from rooms.bank import use_crops
from rooms.render import MAX_STREET_DEPTH_M, RoomFrame, render_room, render_street
from rooms.sample import SCENES, write_sample
from rooms.shards import first_seed, write_shards


def main(
    *,
    output: Annotated[Path | None, typer.Option(help="folder for shards; resumes")] = None,
    contact_sheet: Annotated[Path | None, typer.Option(help="PNG of 12 frames")] = None,
    sample: Annotated[Path | None, typer.Option(help="folder for a sample frame")] = None,
    scene: Annotated[str, typer.Option(help=f"of the sample: {', '.join(SCENES)}")] = "room",
    frames: Annotated[int, typer.Option(min=1, help="how many frames in shards")] = 6000,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of frames in shards")] = "320x240",
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="runs of different seeds share no room")] = 0,
    streets: Annotated[bool, typer.Option("--streets", help="streets in place of rooms")] = False,
    crops: Annotated[
        Path | None, typer.Option(help="textures of `python -m training crops`")
    ] = None,
) -> None:
    """Random rooms on disk."""
    if output is None and contact_sheet is None and sample is None:
        raise typer.BadParameter("give --output, --contact-sheet or --sample")
    if scene not in SCENES:
        raise typer.BadParameter(f"--scene {scene}: there are {', '.join(SCENES)}")
    if not (match := re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", size)):
        raise typer.BadParameter(f"--size {size}: write it as 320x240")
    pixels = int(match[1]), int(match[2])
    if output is not None:
        for path in write_shards(
            output,
            frames=frames,
            size=pixels,
            workers=workers,
            seed=seed,
            streets=streets,
            crops=crops,
        ):
            print(path, flush=True)
    if contact_sheet is not None:
        if crops is not None:
            with np.load(crops) as textures:
                use_crops(textures, seed)
        render = render_street if streets else render_room
        write_contact_sheet(contact_sheet, render, first_seed(seed))
    if sample is not None:
        write_sample(sample, scene)


def write_contact_sheet(path: Path, render: Callable[[int], RoomFrame], first: int) -> None:
    """Image and depth (logarithmic, each over its own range) side by side for 12 seeds."""
    colours = matplotlib.colormaps["turbo_r"]
    cells = []
    for frame in map(render, range(first, first + 12)):
        log_depth = np.log(np.minimum(frame.depth, MAX_STREET_DEPTH_M))
        scaled = (log_depth - log_depth.min()) / max(np.ptp(log_depth), 1e-6)
        depth = (colours(scaled)[..., :3] * 255).astype(np.uint8)
        cells.append(np.concatenate([frame.image, depth], axis=1))
    rows = [np.concatenate(cells[i : i + 3], axis=1) for i in range(0, 12, 3)]
    picture = np.concatenate(rows, axis=0)
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise typer.BadParameter(f"cannot write {path}")


if __name__ == "__main__":
    typer.run(main)
