"""Disparity given as depth: the question is whether it is disparity, and it can be read as such."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from steered_marigold.core.inversion import inversion_doubts
from steered_marigold.io.depth_maps import read_depth

K = torch.tensor([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])


def test_a_slanted_floor(tmp_path: Path) -> None:
    rows = np.arange(1, 121)[:, None]
    disparity = np.broadcast_to(4.0 * rows + 60, (120, 160)).astype(np.uint16)
    Image.fromarray(disparity * 16).save(tmp_path / "d.png")
    as_depth = read_depth(tmp_path / "d.png")
    notices = inversion_doubts(as_depth.depth, as_depth.valid_mask)
    assert [notice.kind for notice in notices] == ["looks_inverse"]
    read = read_depth(
        tmp_path / "d.png", depth_encoding="disparity", depth_scale=1 / 16, K=K, baseline=0.1
    )
    torch.testing.assert_close(read.depth, torch.from_numpy(50 / disparity).float())
    assert inversion_doubts(read.depth, read.valid_mask) == ()


def test_the_case(case: Callable[[str], Path]) -> None:
    path = case("disparity") / "disp256.png"
    as_depth = read_depth(path)
    notices = inversion_doubts(as_depth.depth, as_depth.valid_mask)
    assert [notice.kind for notice in notices] == ["looks_inverse"]
    read = read_depth(path, depth_encoding="disparity", depth_scale=1 / 256, K=K, baseline=0.1)
    truth = read_depth(case("disparity") / "d.png")
    both = read.valid_mask & truth.valid_mask
    ratio = (read.depth / truth.depth)[both]
    assert float(ratio.std() / ratio.mean()) < 0.001
    assert inversion_doubts(truth.depth, truth.valid_mask) == ()
