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
    image = next(SAMPLE.glob("image.*"))
    app(
        ["complete", str(image), str(SAMPLE / "depth.png")]
        + ["--intrinsics", str(SAMPLE / "intrinsics.txt"), "--ensemble", "4"]
        + ["--output", str(out / "depth.png")]
        + ["--visualization", str(out / "panels.png")]
        + ["--point-cloud", str(out / "cloud.ply")]
    )


if __name__ == "__main__":
    main()
