"""Stages begin with a checkpoint's weights, unless they have a run of their own."""

from pathlib import Path

import pytest
import torch
from torch import nn

from steered_marigold.diffusion.checkpoints import load_pipeline
from training import codec, denoiser
from training.__main__ import _start
from training.export import NOTICE
from training.start import CHECKPOINT, load_part


def same_weights(first: nn.Module, second: nn.Module) -> bool:
    there = second.state_dict()
    return all(torch.equal(value, there[name]) for name, value in first.state_dict().items())


def test_parts_of_the_embedded_checkpoint_fit_the_recipe(tmp_path: Path) -> None:
    pipeline = load_pipeline(device="cpu")
    encoder = denoiser.load_image_encoder(tmp_path, CHECKPOINT)
    assert same_weights(encoder, pipeline.image_encoder)
    assert same_weights(denoiser.load_codec(tmp_path, CHECKPOINT), pipeline.vae)
    unet = denoiser.build(encoder.config.latent_channels)
    load_part(unet, CHECKPOINT, "unet")
    assert same_weights(unet, pipeline.unet)


def test_a_run_wins_over_the_checkpoint(tmp_path: Path) -> None:
    trained = codec.build()
    torch.save({"average": trained.state_dict()}, tmp_path / "last.pt")
    assert same_weights(denoiser.load_codec(tmp_path, CHECKPOINT), trained)


def test_scratch_leaves_a_model_as_it_is() -> None:
    model = codec.build()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    load_part(model, None, "vae")
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())


def test_another_shape_is_told() -> None:
    with pytest.raises(ValueError, match="--from scratch"):
        load_part(nn.Linear(1, 1), CHECKPOINT, "vae")


def test_terms_of_nyuv2_do_not_come_in_by_default() -> None:
    assert _start(None, None) is None
    assert _start(None, Path("nyuv2")) == CHECKPOINT
    assert _start("scratch", Path("nyuv2")) is None
    assert _start("folder", None) == Path("folder")


def test_the_terms_lie_beside_the_weights() -> None:
    assert (CHECKPOINT / "NOTICE").read_text(encoding="utf-8") == NOTICE
