"""Tiny random checkpoints of the real classes."""

import json
from pathlib import Path

import pytest
import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from steered_marigold.diffusion.image_encoder import ImageEncoder
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline


def tiny_pipeline(folder: Path, *, with_image_encoder: bool = False) -> SteeredMarigoldPipeline:
    """A pipeline of real, small, random components."""
    torch.manual_seed(0)
    vocabulary = {"<|startoftext|>": 0, "<|endoftext|>": 1}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77
    )
    text = CLIPTextConfig(
        vocab_size=2,
        hidden_size=8,
        intermediate_size=8,
        num_hidden_layers=1,
        num_attention_heads=1,
        bos_token_id=0,
        eos_token_id=1,
        pad_token_id=1,
    )
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
        CLIPTextModel(text).eval(),
        tokenizer,
        image_encoder=encoder.eval() if with_image_encoder else None,
        prediction_type="depth",
        default_denoising_steps=3,
        default_processing_resolution=48,
    )


@pytest.fixture
def pipeline(tmp_path: Path) -> SteeredMarigoldPipeline:
    """Marigold's components, small."""
    pipe = tiny_pipeline(tmp_path)
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture
def pipeline_with_encoder(tmp_path: Path) -> SteeredMarigoldPipeline:
    """The same with an image encoder beside the VAE."""
    pipe = tiny_pipeline(tmp_path, with_image_encoder=True)
    pipe.set_progress_bar_config(disable=True)
    return pipe
