"""How latents and timesteps come to the U-Net."""

import torch

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training.denoiser import change_latents, draw_timesteps, match_latents


def test_latents_are_matched_by_the_encoders_last_layer() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder("lite0", latent_channels=8, pyramid_channels=16).eval()
    images = torch.rand(4, 3, 64, 64) * 2 - 1
    with torch.no_grad():
        old = encoder(images)
        wanted = torch.randn(8, 8)
        other = torch.einsum("oi,nihw->nohw", wanted, old) + 2
        matrix, offset = match_latents(1e4 * old, 1e4 * other)
        change_latents(encoder, matrix, offset / 1e4)
        torch.testing.assert_close(encoder(images), other, atol=1e-2, rtol=1e-2)


def test_latents_that_say_nothing_stay_as_they_are() -> None:
    nothing = torch.zeros(2, 8, 4, 4)
    matrix, offset = match_latents(nothing, nothing)
    torch.testing.assert_close(matrix, torch.eye(8))
    assert not offset.any()


def test_most_timesteps_are_noisy_and_a_single_step_is_practised() -> None:
    told = torch.arange(4000) % 2 == 0
    t = draw_timesteps(told, torch.Generator().manual_seed(0))
    assert t.min() >= 0
    assert t.max() == 999
    assert t[told].min() >= 500
    first = t == 999
    assert 0.55 < first[told].float().mean() < 0.7
    assert 0.15 < first[~told].float().mean() < 0.25
