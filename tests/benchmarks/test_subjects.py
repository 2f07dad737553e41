"""The models and frames that are measured."""

from collections.abc import Mapping
from typing import Any

import pytest
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel

from benchmarks.subjects import FULL_SIZE_UNET, FULL_SIZE_VAE, sample_frame


@pytest.mark.parametrize(
    ("kind", "config", "parameters"),
    [
        # Stable Diffusion 2 has 865 910 724; four more input channels of 3x3x320 are Marigold's
        (UNet2DConditionModel, FULL_SIZE_UNET, 865_910_724 + 4 * 9 * 320),
        (AutoencoderKL, FULL_SIZE_VAE, 83_653_863),
    ],
    ids=["unet", "vae"],
)
def test_full_size_is_that_of_stable_diffusion_2(
    kind: type, config: Mapping[str, Any], parameters: int
) -> None:
    with torch.device("meta"):
        model = kind(**config)
    assert sum(parameter.numel() for parameter in model.parameters()) == parameters


def test_a_frame_has_the_size_and_the_measurements_asked_for() -> None:
    frame = sample_frame(80, 56, 300)
    assert frame.image.shape == (56, 80, 3)
    assert frame.sparse_depth.shape == frame.mask.shape == (56, 80)
    assert int(frame.mask.sum()) == 300
    assert bool((frame.sparse_depth > 0).all())
    assert torch.equal(frame.mask, sample_frame(80, 56, 300).mask)
