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
    surface = ndimage.median_filter(completion.depth[0].numpy(), 17)
    spikes = lone & (abs(np.log(frame.sparse_depth.numpy().clip(0.1) / surface)) > 0.2)
    assert spikes.sum() >= 4
    assert not (completion.trusted[0].numpy() & spikes).any()
    sigma = completion.uncertainty
    assert sigma is not None
    assert float(sigma[0].numpy()[spikes].min()) > 0.5
    assert completion.trusted.sum() > 0.995 * measured.sum()
