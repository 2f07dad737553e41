"""Readings of 65 m on a wet floor were trusted, with an uncertainty of 0."""

from collections.abc import Callable
from pathlib import Path

from steered_marigold import create_method
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame

FAR_M = 40.0
FLOOR_FROM = 115  # row


def test_the_case(case: Callable[[str], Path]) -> None:
    folder = case("trusted_false_far")
    files = FrameFiles(image=folder / "rgb.jpg", depth=folder / "depth.png")
    frame = read_frame(files, Reading())
    completion = create_method("fast", dtype="float32").answer(frame)
    false = frame.sparse_depth > FAR_M
    false[:FLOOR_FROM] = False  # above is the sky
    assert int(false.sum()) > 900
    assert int((false & completion.trusted[0]).sum()) < 0.1 * int(false.sum())
    assert completion.uncertainty is not None
    assert float(completion.uncertainty.min()) > 0
    assert float(completion.uncertainty[0][false].median()) > 1.0
