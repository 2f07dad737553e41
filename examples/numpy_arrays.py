"""NumPy in, NumPy out: an image and an incomplete depth map in metres become a dense one."""

from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from steered_marigold import DepthCompleter, SteeredCompleter

SAMPLE = Path(str(files("steered_marigold") / "assets" / "sample"))


def complete(
    completer: DepthCompleter, image: NDArray[np.uint8], depth: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Dense depth and its standard deviation [m], [height, width] each.

    image: RGB, [height, width, 3]. depth: [m]; 0 or NaN where nothing was measured.
    """
    completion = completer.complete(image, depth)
    assert completion.uncertainty is not None  # presets "default" and "fast" always state it
    return completion.depth[0].numpy(), completion.uncertainty[0].numpy()


def main() -> None:
    """The package's sample frame."""
    image = np.array(Image.open(SAMPLE / "image.jpg"))
    depth = np.array(Image.open(SAMPLE / "depth.png"), np.float32) * np.float32(0.001)
    completer = SteeredCompleter.from_checkpoint(preset="fast", device="cpu")
    dense, sigma = complete(completer, image, depth)
    print(f"{np.mean(depth > 0):.0%} measured; {dense.min():.2f} to {dense.max():.2f} m")
    print(f"{np.mean(sigma < 0.05 * dense):.0%} sure to 5 %")


if __name__ == "__main__":
    main()
