"""Completes the sample frame of the package with the embedded checkpoint; needs no network.

Writes the dense depth, a picture and a point cloud into ./demo, and prints their paths.
"""

from pathlib import Path

import steered_marigold
from steered_marigold.cli import app

SAMPLE = Path(steered_marigold.__file__).parent / "assets" / "sample"


def main() -> None:
    """What `make demo` runs: `steered-marigold complete` on the sample."""
    out = Path("demo")
    out.mkdir(exist_ok=True)
    options = {
        "--intrinsics": SAMPLE / "intrinsics.txt",
        "--output": out / "depth.png",
        "--visualization": out / "panels.png",
        "--point-cloud": out / "cloud.ply",
    }
    words = [str(word) for option in options.items() for word in option]
    image = next(SAMPLE.glob("image.*"))
    app(["complete", str(image), str(SAMPLE / "depth.png"), *words])


if __name__ == "__main__":
    main()
