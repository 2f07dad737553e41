"""steered-marigold view: results as a Rerun recording."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from steered_marigold.cli.messages import say


def view(
    image: Annotated[Path, Argument(help="An image, or a folder of them.")],
    dense: Annotated[Path, Argument(help="Its completed depth, or the folder of it.")],
    *,
    output: Annotated[Path, Option("-o", "--output", help="The .rrd to write.")],
    depth: Annotated[
        Path | None, Option(help="What the sensor had measured, or the folder of it.")
    ] = None,
    uncertainty: Annotated[
        Path | None, Option(help="The uncertainty that was written, or the folder of it.")
    ] = None,
    intrinsics: Annotated[str | None, Option(help="K, as in `complete`; for point clouds.")] = None,
) -> None:
    """Write results as a Rerun recording: pictures, depth and clouds over time.

    Open it with `rerun OUT.rrd` (from rerun-sdk), which is not started for you.
    """
    from steered_marigold.frames.sources import FrameFiles, Reading
    from steered_marigold.frames.viewing import rerun_log, written_results
    from steered_marigold.io.intrinsics import read_intrinsics

    reading = Reading(intrinsics=None if intrinsics is None else read_intrinsics(intrinsics))
    results = written_results(FrameFiles(image=image, depth=depth), dense, uncertainty, reading)
    count = 0
    with rerun_log(output) as viewing:
        for frame, completion in results:
            viewing.add(frame, completion)
            count += 1
    say(f"{output}: {count} frames")
