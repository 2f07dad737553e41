"""A folder of frames, completed on a Ray cluster.

    python -m examples.ray_cluster IMAGES DEPTHS OUTPUT [ADDRESS]

`steered-marigold complete IMAGES DEPTHS -o OUTPUT --engine ray` does the same. Without an address a
cluster of this machine is begun. Given again, it goes on where it was.
"""

import sys
from functools import partial
from pathlib import Path
from typing import Any

from steered_marigold import Outputs, SteeredCompleter
from steered_marigold.batch.cluster import RayEngine
from steered_marigold.batch.engines import Engine
from steered_marigold.batch.job import JobSettings, plan
from steered_marigold.batch.manifest import describe_model, describe_settings
from steered_marigold.batch.run import complete_all
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source

MODEL: dict[str, Any] = {"checkpoint": "embedded", "preset": "fast"}


def main(engine: Engine, images: Path, depths: Path, output: Path) -> int:
    """Completes what has no result yet; how many frames failed."""
    inputs, reading, settings = FrameFiles(image=images, depth=depths), Reading(), JobSettings()
    source = folder_source(inputs, reading)
    todo = plan(source, Outputs(depth=output), suffix=".png", overwrite=False)
    # what the results depend on: with other settings, output is refused the next time
    model = describe_model(MODEL) | {"threads": engine.threads}
    described = describe_settings(inputs, reading, settings, model, todo.suffix)
    load = partial(SteeredCompleter.from_checkpoint, **MODEL)  # once in each actor
    failed = 0
    for outcome in complete_all(load, todo, settings, described, engine=engine):
        print(f"{outcome.frame}: {outcome.error or 'completed'}")
        failed += outcome.error is not None
    return failed


if __name__ == "__main__":
    address = sys.argv[4] if len(sys.argv) > 4 else None
    sys.exit(main(RayEngine(address=address), *map(Path, sys.argv[1:4])) > 0)
