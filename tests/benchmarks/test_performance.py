"""The tables, end to end on tiny models."""

import pytest
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from torch import nn

from benchmarks import performance
from benchmarks.performance import FLOAT32
from benchmarks.runs import RUNS
from benchmarks.stages import BFLOAT16
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from tests.diffusion.conftest import tiny_pipeline

STAGES = {"image", "unet", "decode", "encode", "steer: prepare, once", "steer: target, each step"}


def quiet_pipeline(dtype: torch.dtype = torch.float32) -> SteeredMarigoldPipeline:
    pipe = tiny_pipeline(with_image_encoder=True)
    for model in (pipe.unet, pipe.vae, pipe.image_encoder):
        nn.Module.to(model, dtype)
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture(autouse=True)
def fast_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One run beside the reference is enough here."""
    monkeypatch.setattr(performance, "RUNS", {"fast": RUNS["fast"]})
    monkeypatch.setattr(performance, "OURS", ("fast",))


def test_embedded_images_are_all_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(performance, "embedded_pipeline", quiet_pipeline)
    content = performance.measure_embedded("64x48", repeats=1)
    assert content["stages"].keys() == STAGES | {"finish"}
    variants = [("reference", FLOAT32), ("fast", FLOAT32), ("fast", BFLOAT16)]
    assert [(row["run"], row["precision"]) for row in content["images"]] == variants
    assert all(row["measured"].median > 0 < row["seconds"] for row in content["images"])


def test_full_size_images_say_that_they_are_extrapolated(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = tiny_pipeline()
    assert isinstance(tiny.unet, UNet2DConditionModel)
    assert isinstance(tiny.vae, AutoencoderKL)
    monkeypatch.setattr(performance, "stand_in_pipeline", lambda steps: quiet_pipeline())
    monkeypatch.setattr(performance, "full_size_unet", lambda: tiny.unet)
    monkeypatch.setattr(performance, "full_size_vae", lambda: tiny.vae)
    monkeypatch.setattr(performance, "FULL_SIZE_PROMPT_CHANNELS", 8)
    content = performance.measure_full_size("64x48", steps=3, repeats=1)
    rows = content["extrapolated_images"]
    assert [row["run"] for row in rows] == ["reference", "fast", "fast"]
    assert rows[0]["times_faster"] == 1
    printed = capsys.readouterr().out
    assert "Whole images are extrapolated, not run" in printed
    assert "| reference | float32 | 50 | 51 | 50 | 0 | 0 |" in printed
