"""Tiny random checkpoints of the real classes."""

import pytest
import torch
from diffusers import AutoencoderKL, AutoencoderTiny, DDIMScheduler, UNet2DConditionModel

from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from training.export import two_word_prompt


def tiny_pipeline(*, with_image_encoder: bool = False) -> SteeredMarigoldPipeline:
    """A pipeline of real, small, random components."""
    torch.manual_seed(0)
    image_channels = 6 if with_image_encoder else 4
    unet = UNet2DConditionModel(
        in_channels=image_channels + 4,
        out_channels=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
        block_out_channels=(8, 16),
        layers_per_block=1,
        cross_attention_dim=8,
        attention_head_dim=8,
        norm_num_groups=4,
    )
    vae = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4,
        block_out_channels=(4, 8, 8, 8),
        latent_channels=4,
        norm_num_groups=4,
    )
    encoder = ImageEncoder("lite0", latent_channels=6, pyramid_channels=8)
    text_encoder, tokenizer = two_word_prompt(8)
    return SteeredMarigoldPipeline(
        unet.eval(),
        vae.eval(),
        DDIMScheduler(
            beta_schedule="scaled_linear",
            beta_start=0.00085,
            beta_end=0.012,
            prediction_type="v_prediction",
            clip_sample=False,
            set_alpha_to_one=False,
            steps_offset=1,
        ),
        text_encoder,
        tokenizer,
        image_encoder=encoder.eval() if with_image_encoder else None,
        prediction_type="depth",
        default_denoising_steps=3,
        default_processing_resolution=48,
    )


def tiny_steering_vae() -> AutoencoderTiny:
    """A small random codec of TAESD's kind."""
    torch.manual_seed(0)
    return AutoencoderTiny(
        encoder_block_out_channels=(4,) * 4,
        decoder_block_out_channels=(4,) * 4,
        num_encoder_blocks=(1,) * 4,
        num_decoder_blocks=(1,) * 4,
    ).eval()


@pytest.fixture
def pipeline() -> SteeredMarigoldPipeline:
    """Marigold's components, small."""
    pipe = tiny_pipeline()
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture
def pipeline_with_encoder() -> SteeredMarigoldPipeline:
    """The same with an image encoder beside the VAE."""
    pipe = tiny_pipeline(with_image_encoder=True)
    pipe.set_progress_bar_config(disable=True)
    return pipe
