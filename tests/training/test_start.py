"""Stages begin with a checkpoint's weights, unless they have a run of their own."""

from pathlib import Path

import pytest
import torch
from torch import nn

from steered_marigold.diffusion.checkpoints import load_pipeline
from training import codec, denoiser
from training.__main__ import _start
from training.export import procedural_only
from training.mixture import Sources
from training.start import CHECKPOINT, blend, load_part
from training.terms import NOTICE, PROCEDURAL, RESEARCH, is_procedural
from training.trainer import Trainer


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


def test_a_blend_lies_between() -> None:
    before, after = codec.build(), codec.build()
    load_part(before, CHECKPOINT, "vae")
    trained = {name: value.clone() for name, value in after.state_dict().items()}
    blend(after, CHECKPOINT, "vae", 0.25)
    for name, value in after.state_dict().items():
        expected = 0.25 * trained[name] + 0.75 * before.state_dict()[name]
        torch.testing.assert_close(value, expected)
    with pytest.raises(ValueError, match="share"):
        blend(after, None, "vae", 0.5)


def test_another_shape_is_told() -> None:
    with pytest.raises(ValueError, match="--from scratch"):
        load_part(nn.Linear(1, 1), CHECKPOINT, "vae")


def test_terms_of_nyuv2_do_not_come_in_by_default() -> None:
    rooms, photographs = Sources(rooms=[Path("rooms")]), Sources(rgbd=Path("rgbd"))
    assert _start(None, rooms) is None
    assert _start(None, photographs) == CHECKPOINT
    assert _start("scratch", photographs) is None
    assert _start("folder", rooms) == Path("folder")


def test_the_terms_lie_beside_the_weights() -> None:
    assert (CHECKPOINT / NOTICE).read_text(encoding="utf-8") == RESEARCH
    assert not is_procedural(CHECKPOINT)


def test_one_stage_with_nyuv2_makes_the_weights_for_research(tmp_path: Path) -> None:
    def record(stage: str, **state: bool) -> None:
        (tmp_path / stage).mkdir(exist_ok=True)
        torch.save(state, tmp_path / stage / "last.pt")

    for stage in ("image_branch", "codec", "denoiser"):
        record(stage, procedural_only=True)
    assert procedural_only(tmp_path)
    assert not procedural_only(tmp_path, CHECKPOINT)
    record("codec", procedural_only=False)
    assert not procedural_only(tmp_path)
    record("codec")
    assert not procedural_only(tmp_path)


def test_a_run_stays_for_research_once_it_was(tmp_path: Path) -> None:
    def run(procedural: bool) -> bool:
        trainer = Trainer(nn.Linear(1, 1), [], tmp_path, 0, procedural)
        trainer._record(0, 0, 0, {}, None)
        return bool(torch.load(tmp_path / "last.pt", weights_only=True)["procedural_only"])

    assert [run(True), run(True), run(False), run(True)] == [True, True, False, False]


def test_a_procedural_checkpoint_says_so(tmp_path: Path) -> None:
    (tmp_path / NOTICE).write_text(PROCEDURAL, encoding="utf-8")
    assert is_procedural(tmp_path)
    assert is_procedural(None)
