"""Stage 4: the three trained parts as one checkpoint in Marigold's layout, float16 on disk."""

import json
import shutil
import tempfile
from pathlib import Path

import torch
from diffusers import DDIMScheduler
from torch import nn
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from training import denoiser
from training.data import WIDTH
from training.start import blend
from training.terms import NOTICE, PROCEDURAL, RESEARCH, is_procedural

STEPS = 1


def two_word_prompt(channels: int) -> tuple[CLIPTextModel, CLIPTokenizer]:
    """An untrained text encoder for the empty prompt's two tokens alone, and its tokenizer."""
    with tempfile.TemporaryDirectory() as folder:
        vocabulary, merges = Path(folder) / "vocab.json", Path(folder) / "merges.txt"
        vocabulary.write_text(json.dumps({"<|startoftext|>": 0, "<|endoftext|>": 1}))
        merges.write_text("#version: 0.2\n")
        tokenizer = CLIPTokenizer(str(vocabulary), str(merges), model_max_length=77)
    config = CLIPTextConfig(
        vocab_size=2,
        hidden_size=channels,
        intermediate_size=channels,
        num_hidden_layers=1,
        num_attention_heads=1,
        bos_token_id=0,
        eos_token_id=1,
        pad_token_id=1,
    )
    return CLIPTextModel(config).eval(), tokenizer


def empty_prompt(channels: int) -> tuple[CLIPTextModel, CLIPTokenizer]:
    """The same with every embedding 0, as in training."""
    encoder, tokenizer = two_word_prompt(channels)
    for parameter in encoder.parameters():
        nn.init.zeros_(parameter)
    return encoder, tokenizer


def assemble(
    runs: Path, start: Path | None = None, *, share: float = 1.0
) -> SteeredMarigoldPipeline:
    """The pipeline of a finished training run.

    start: the checkpoint with which the denoiser stage began, for frozen parts without a run.
    share: of the trained weights; the rest are those of `start`, which they began with.
    """
    encoder = denoiser.load_image_encoder(runs / "image_branch", start)
    codec = denoiser.load_codec(runs / "codec", start)
    scales = torch.load(runs / "denoiser" / "scales.pt", weights_only=True)
    denoiser.change_latents(encoder, scales["matrix"], scales["offset"])
    codec.register_to_config(scaling_factor=scales["depth"])
    unet = denoiser.average_of(runs / "denoiser", denoiser.build(encoder.config.latent_channels))
    if share < 1:
        blend(encoder, start, "image_encoder", share)
        blend(unet, start, "unet", share)
    text_encoder, tokenizer = empty_prompt(denoiser.TEXT_CHANNELS)
    return SteeredMarigoldPipeline(
        unet,
        codec,
        DDIMScheduler(**denoiser.SCHEDULER),
        text_encoder,
        tokenizer,
        image_encoder=encoder,
        prediction_type="depth",
        default_denoising_steps=STEPS,
        default_processing_resolution=WIDTH,
        continues_known=True,
    )


def procedural_only(runs: Path, start: Path | None = None) -> bool:
    """Whether photographs had no part in any stage of `runs`, nor in the checkpoint `start`."""
    stages = [runs / name / "last.pt" for name in ("image_branch", "codec", "denoiser")]
    trained = [torch.load(path, weights_only=True) for path in stages if path.exists()]
    return is_procedural(start) and all(run.get("procedural_only", False) for run in trained)


def export(runs: Path, target: Path, start: Path | None = None, *, share: float = 1.0) -> None:
    """Writes the checkpoint of `runs` to the folder `target`, replacing what is there.

    start, share: see `assemble`.
    """
    temporary = target.with_name(target.name + ".part")
    shutil.rmtree(temporary, ignore_errors=True)
    pipeline = assemble(runs, start, share=share).to(torch.float16)
    pipeline.save_pretrained(temporary, safe_serialization=True)
    terms = PROCEDURAL if procedural_only(runs, start) else RESEARCH
    (temporary / NOTICE).write_text(terms, encoding="utf-8")
    shutil.rmtree(target, ignore_errors=True)
    temporary.replace(target)
