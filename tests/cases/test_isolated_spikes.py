"""Single readings in dark glass grew into cones, with an uncertainty of a few centimetres."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import ndimage

from steered_marigold import create_method
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame


def test_the_case(case: Callable[[str], Path]) -> None:
    folder = case("isolated_spikes")
    files = FrameFiles(image=folder / "rgb.jpg", depth=folder / "depth.png")
    frame = read_frame(files, Reading())
    completion = create_method("fast", dtype="float32").answer(frame)
    measured = frame.valid_mask.numpy()
    around = ndimage.uniform_filter(measured.astype(np.float32), 25, mode="constant") * 25**2
    lone = measured & (around < 4)
    assert lone.sum() >= 5
    assert (~completion.trusted[0].numpy())[lone].mean() > 0.8
    assert completion.trusted.sum() > 0.995 * measured.sum()
