"""A bag of a depth camera: the same bag with dense depth, and one frame of it in Python.

    python -m examples.recording IN.bag OUT.bag        # pip install 'steered-marigold[ros]'

`steered-marigold bag IN.bag -o OUT.bag` does the first half.
"""

import sys
from itertools import islice
from pathlib import Path

from steered_marigold import DepthCompleter, DepthCompletion, SteeredCompleter, complete_frame
from steered_marigold.datasets.recording import recorded_frame
from steered_marigold.frames.complete import Record
from steered_marigold.frames.recordings import Tally, complete_recording
from steered_marigold.io.bags import open_recording


def copy_with_depth(completer: DepthCompleter, source: Path, target: Path) -> Tally:
    """Every message of the source, and DEPTH_TOPIC/completed beside them."""

    def tell(record: Record | None, tally: Tally) -> None:
        print(f"{tally.completed} completed, {len(tally.failed)} failed")

    with open_recording(source) as recording:
        copied, tally = complete_recording(
            completer, recording, recording.frames(slop=0.02), target, on_frame=tell
        )
    print(f"{copied.path}: {copied.copied} messages copied, {copied.added} added")
    return tally


def first_frame(completer: DepthCompleter, source: Path) -> DepthCompletion:
    """The completion of the first paired frame."""
    with open_recording(source) as recording:
        (recorded,) = islice(recording.frames(), 1)
        completion, _ = complete_frame(completer, recorded_frame(recorded))
    return completion


if __name__ == "__main__":
    model = SteeredCompleter.from_checkpoint(preset="fast")
    copy_with_depth(model, Path(sys.argv[1]), Path(sys.argv[2]))
