"""A video whose camera is tracked: what one frame measured fills the holes of the next.

    python -m examples.stream_with_poses FOLDER OUTPUT fx,fy,cx,cy

FOLDER holds rgb/, depth/ (uint16 millimetres) and pose/ (NNNN.txt: 4x4, camera to world, metres).
Without poses leave `pose` out: the motion is then estimated from image and depth.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from steered_marigold import DepthCompleter, Frame, Outputs, StreamingCompleter, make_frame, save
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image
from steered_marigold.io.intrinsics import read_intrinsics


def frames(folder: Path, intrinsics: str) -> Iterator[Frame]:
    """The frames in order, each with K and pose."""
    camera = read_intrinsics(intrinsics)
    for path in sorted((folder / "rgb").iterdir()):
        image = read_image(path).pixels
        measured = read_depth(folder / "depth" / f"{path.stem}.png")
        K, _ = camera.for_image((image.shape[0], image.shape[1]))
        pose = np.loadtxt(folder / "pose" / f"{path.stem}.txt")
        yield make_frame(image, measured.depth, measured.valid_mask, K=K, pose=pose, id=path.stem)


def main(stream: DepthCompleter, source: Iterator[Frame], output: Path) -> int:
    """Writes dense depth of every frame; returns how many there were."""
    output.mkdir(parents=True, exist_ok=True)
    count = 0
    for frame in source:
        completion = stream.answer(frame)
        save(completion, frame, Outputs(depth=output / f"{frame.id}.png"))
        print(f"{frame.id}: {completion}")
        count += 1
    return count


if __name__ == "__main__":
    _, folder, output, intrinsics = sys.argv
    main(StreamingCompleter.from_checkpoint(), frames(Path(folder), intrinsics), Path(output))
