"""1296x968 and 640x480 differ by 2 px of aspect; the advice names the crop."""

import pytest
import torch

from steered_marigold.core.registration import register_depth
from steered_marigold.errors import SizeMismatchError


def test_the_crop_that_fits_is_named_and_fits() -> None:
    depth = torch.ones(480, 640)
    with pytest.raises(SizeMismatchError, match="crop the image to 1291x968"):
        register_depth(depth, depth > 0, (968, 1296))
    assert int(register_depth(depth, depth > 0, (968, 1291)).valid_mask.sum()) == 480 * 640
