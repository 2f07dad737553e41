"""Plans a run over many frames and prints seconds and megabytes: python -m tests.faults.many N DIR.

N empty image files, N depth files, results of half of them: listed, paired, and a resumed run
planned to its last task. Megabytes are those of the plan, above the libraries'.
"""

import resource
import sys
from pathlib import Path
from time import perf_counter

from steered_marigold.batch.job import plan
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source

ROOT = Path(__file__).resolve().parents[2]


def make(root: Path, count: int) -> FrameFiles:
    """Names are what counts: files are links to one empty file."""
    images, depths, out = (root / name for name in ("images", "depths", "out"))
    for folder in (images, depths, out):
        folder.mkdir()
    for index in range(count):
        name = f"{index:07d}.png"
        (images / name).touch()
        (depths / name).touch()
        if index % 2:
            (out / name).touch()
    return FrameFiles(image=images, depth=depths)


def main(count: int, root: Path) -> None:
    """Writes the cost to stdout."""
    inputs = make(root, count)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = perf_counter()
    source = folder_source(inputs, Reading())
    todo = plan(source, Outputs(depth=root / "out"), suffix=".png", overwrite=False)
    tasks = sum(1 for _ in todo.tasks())
    seconds = perf_counter() - started
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert tasks == count - count // 2 == count - todo.skipped
    sys.stdout.write(f"{seconds:.1f} {grown / 1024:.0f}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
