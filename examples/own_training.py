"""The embedded checkpoint, trained on from your own RGB-D frames.

    python -m examples.own_training FRAMES OUTPUT        # pip install 'steered-marigold[train]'

FRAMES holds rgb/ and depth/ (uint16 millimetres, 0 = unknown), paired by name; every tenth frame is
held out for the curve in OUTPUT/runs/denoiser/log.csv. OUTPUT/checkpoint is then a folder for
`--checkpoint`. Only the U-Net learns here; docs/training.md has all stages, and what they start
from. The weights carry the terms of the embedded ones, and those of your frames.
"""

import csv
import shutil
import sys
from pathlib import Path

from training import denoiser
from training.data import read_frame
from training.export import assemble
from training.held_out import truth_of
from training.mixture import Sources
from training.start import CHECKPOINT

HELD_OUT = 10


def main(frames: Path, output: Path, *, minutes: float = 60, pool: int = 2048) -> Path:
    """Trains for so many minutes of the processor; returns the checkpoint's folder."""
    pairs = sorted((frames / "rgb").iterdir())
    held_out, training = pairs[::HELD_OUT], [p for i, p in enumerate(pairs) if i % HELD_OUT]
    depth_of = {path: frames / "depth" / f"{path.stem}.png" for path in pairs}
    own = output / "frames"
    _as_source(own, [(path, depth_of[path]) for path in training])
    truth = [truth_of(read_frame(path, depth_of[path])) for path in held_out]

    denoiser.train(
        Sources(rgbd=own),
        output / "runs",
        minutes=minutes,
        tune={"own": truth},
        start=CHECKPOINT,
        pool=pool,
    )
    checkpoint = output / "checkpoint"
    assemble(output / "runs", CHECKPOINT).save_pretrained(checkpoint)
    return checkpoint


def _as_source(folder: Path, pairs: list[tuple[Path, Path]]) -> None:
    """The layout that `training.rgbd` reads; frames of one folder count as one scene."""
    (folder / "own").mkdir(parents=True, exist_ok=True)
    with (folder / "index.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("source", "id", "scene"))
        for index, (image, depth) in enumerate(pairs):
            shutil.copyfile(image, folder / "own" / f"{index:04d}.jpg")  # read by its content
            shutil.copyfile(depth, folder / "own" / f"{index:04d}.png")
            writer.writerow(("own", f"{index:04d}", "own"))


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2])))
