"""The Python API on the package's sample frame: read, complete, keep what is sure, write.

Runs offline on a CPU. Writes depth.exr and cloud.ply into ./demo/python.
"""

from importlib.resources import files
from pathlib import Path

import torch

from steered_marigold import DepthCompletion, SteeredCompleter
from steered_marigold.io.depth_maps import read_depth, write_depth
from steered_marigold.io.images import read_image
from steered_marigold.io.intrinsics import read_intrinsics
from steered_marigold.io.point_clouds import point_cloud, write_point_cloud

SAMPLE = Path(str(files("steered_marigold") / "assets" / "sample"))


def main(output: Path) -> DepthCompletion:
    """Completes the sample, prints a summary, writes two files into `output`."""
    image = read_image(SAMPLE / "image.jpg").pixels  # uint8 [height, width, 3]
    sensor = read_depth(SAMPLE / "depth.png")  # metres, and a mask of what was measured

    completer = SteeredCompleter.from_checkpoint("embedded", preset="fast", device="cpu")
    completion = completer.complete(
        image, sensor.depth, sensor.valid_mask, generator=torch.Generator().manual_seed(0)
    )
    assert completion.uncertainty is not None  # presets "default" and "fast" always state it
    depth, uncertainty = completion.depth[0], completion.uncertainty[0]

    sure = uncertainty < 0.05 * depth
    print(
        f"measured {completion.measured.float().mean():.0%}, sure to 5 % {sure.float().mean():.0%}"
    )

    output.mkdir(parents=True, exist_ok=True)
    write_depth(output / "depth.exr", depth)
    K = read_intrinsics(SAMPLE / "intrinsics.txt").K
    kept = torch.where(sure, depth, 0.0)  # 0 is "unknown" in files and clouds
    write_point_cloud(output / "cloud.ply", point_cloud(kept, image, K))
    return completion


if __name__ == "__main__":
    main(Path("demo") / "python")
