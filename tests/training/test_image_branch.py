"""Stage 1: what it leaves out in training, and what it trains on."""

from pathlib import Path
from typing import Any

import pytest
import torch
from typer.testing import CliRunner

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training import image_branch
from training.__main__ import app
from training.mixture import Sources


def test_blocks_are_left_out_in_training_alone() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder("lite0", latent_channels=8, pyramid_channels=16)
    image = torch.rand(1, 3, 64, 64)
    before = encoder.eval()(image)
    image_branch.drop_blocks(encoder)
    torch.testing.assert_close(encoder(image), before)
    several = encoder.train()(image.expand(32, -1, -1, -1))
    assert not torch.equal(several, several[:1].expand_as(several))


def test_what_is_left_out_does_not_change_the_mean() -> None:
    block = torch.nn.Identity().train()
    x, y = torch.ones(40_000, 1, 1, 1), torch.full((40_000, 1, 1, 1), 3.0)
    kept = image_branch._drop(block, (x,), y, chance=0.2)
    assert kept.mean().item() == pytest.approx(3, abs=0.05)
    assert kept.min() == 1


@pytest.mark.parametrize("only", [True, False])
def test_procedural_only_keeps_photographs_out_of_training(
    only: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class ReadError(Exception):
        pass

    def read(sources: Sources, **_: Any) -> None:
        raise ReadError(sources)

    monkeypatch.setattr(image_branch, "MixedFrames", read)
    monkeypatch.setattr("training.__main__.held_out", lambda *_: {})
    flag = ["--procedural-only"] if only else []
    folders = ["--rooms", "R", "--rooms", "S", "--nyuv2", "N", "--rgbd", "D"]
    result = CliRunner().invoke(app, ["image-branch", "--runs", str(tmp_path), *folders, *flag])
    assert isinstance(result.exception, ReadError)
    rooms = [Path("R"), Path("S")]
    expected = Sources(rooms=rooms) if only else Sources(Path("N"), Path("D"), rooms)
    assert result.exception.args == (expected,)
    assert expected.procedural_only == only
