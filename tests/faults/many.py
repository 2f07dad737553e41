"""Plans a run over many frames: python -m tests.faults.many N EMPTY_FOLDER [IMAGE DEPTH].

N empty image files, N depth files, results of half of them: listed, paired, and a resumed run
planned to its last task. IMAGE, DEPTH: their names, as "{:07d}.png".

Prints seconds (of the wall, of the processor) and megabytes: the peak of the process, with the
libraries, and how many of them are the plan's.
"""

import resource
import sys
from pathlib import Path
from time import perf_counter, process_time

from steered_marigold.batch.job import plan
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source

ROOT = Path(__file__).resolve().parents[2]


def make(root: Path, count: int, image: str, depth: str) -> FrameFiles:
    """Names are what counts: the files are empty."""
    images, depths, out = (root / name for name in ("images", "depths", "out"))
    for folder in (images, depths, out):
        folder.mkdir()
    for index in range(count):
        (images / image.format(index)).touch()
        (depths / depth.format(index)).touch()
        if index % 2:
            (out / f"{Path(image.format(index)).stem}.png").touch()
    return FrameFiles(image=images, depth=depths)


def main(count: int, root: Path, image: str = "{:07d}.png", depth: str = "{:07d}.png") -> None:
    """Writes the cost to stdout."""
    inputs = make(root, count, image, depth)
    before, started, busy = _peak_mb(), perf_counter(), process_time()
    source = folder_source(inputs, Reading())
    todo = plan(source, Outputs(depth=root / "out"), suffix=".png", overwrite=False)
    tasks = sum(1 for _ in todo.tasks())
    seconds, busy, peak = perf_counter() - started, process_time() - busy, _peak_mb()
    assert tasks == count - count // 2 == count - todo.skipped
    sys.stdout.write(f"{seconds:.1f} {busy:.1f} {peak:.0f} {peak - before:.0f}\n")


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
