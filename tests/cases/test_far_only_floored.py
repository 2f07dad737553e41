"""With only far depth measured, more than half of a frame became the 5 cm floor, without a word."""

from collections.abc import Callable
from pathlib import Path

from steered_marigold import create_method
from steered_marigold.frames.complete import complete_frame
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame
from steered_marigold.io.depth_maps import read_depth


def test_the_case(case: Callable[[str], Path]) -> None:
    folder = case("far_only_floored")
    files = FrameFiles(image=folder / "rgb.png", depth=folder / "rs0_far4.npy")
    completion, record = complete_frame(
        create_method("fast", dtype="float32"), read_frame(files, Reading())
    )
    truth = read_depth(folder / "truth.png")
    assert record.values["floored"] < 0.01 * truth.depth.numel()
    depth, sigma = completion.depth[0], completion.uncertainty
    assert sigma is not None
    hidden = truth.valid_mask & ~completion.measured[0]
    error = (depth - truth.depth).abs()[hidden]
    assert float((error / truth.depth[hidden]).mean()) < 0.5
    assert float((error < 2 * sigma[0][hidden] + 0.04).float().mean()) > 0.8
