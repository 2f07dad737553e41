"""Two folders, frame by frame, with a decision of your own between them.

    python -m examples.folder IMAGES DEPTHS OUTPUT

`steered-marigold complete IMAGES DEPTHS -o OUTPUT` does the same without the decision.
"""

import sys
from pathlib import Path

from steered_marigold import DepthCompleter, Outputs, SteeredCompleter, complete_frame, save
from steered_marigold.frames.sources import FrameFiles, Reading, folder_source


def main(
    completer: DepthCompleter, images: Path, depths: Path, output: Path, *, least: float = 0.01
) -> list[str]:
    """Completes the frames of which at least this share was measured; returns the others' ids."""
    source = folder_source(FrameFiles(image=images, depth=depths), Reading(no_measurements=True))
    output.mkdir(parents=True, exist_ok=True)
    left_out = []
    for frame_id in source.ids:
        frame = source.load(frame_id)
        if frame.valid_mask.float().mean() < least:
            left_out.append(frame_id)
            continue
        completion, record = complete_frame(completer, frame)
        save(completion, frame, Outputs(depth=output / f"{frame_id}.png"))
        print(f"{frame_id}: {record.values['seconds']} s, {completion}")
        for notice in record.notices:
            print(f"  {notice.text}")
    return left_out


if __name__ == "__main__":
    main(SteeredCompleter.from_checkpoint(preset="fast"), *map(Path, sys.argv[1:4]))
