from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image

from steered_marigold.evaluation.figures import draw_figures
from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.evaluation.steering_figure import record_steering
from steered_marigold.methods.registry import create_method
from steered_marigold.methods.steered import SteeredCompleter
from tests.diffusion.conftest import tiny_pipeline


@pytest.fixture
def frame(tiny: RunSettings) -> PreparedFrame:
    return Evaluator(tiny).prepare("f0")


@pytest.fixture
def completer() -> SteeredCompleter:
    """The paper's preset, three steps, on a tiny random checkpoint."""
    pipeline = tiny_pipeline()
    return SteeredCompleter(pipeline, "tiny", preset="paper", num_inference_steps=3)


def test_records_each_step_and_changes_nothing(
    completer: SteeredCompleter, frame: PreparedFrame
) -> None:
    def answer() -> torch.Tensor:
        return completer.answer(frame.shown, generator=torch.Generator().manual_seed(5)).depth

    answers = [answer()]
    steps = record_steering(completer, frame, generator=torch.Generator().manual_seed(5))
    answers.append(answer())
    assert torch.equal(*answers)
    assert len(steps) == 3
    assert steps[0].timestep > steps[1].timestep > steps[2].timestep
    for step in steps:
        assert step.predicted.shape == step.target.shape
        assert float(step.predicted.abs().max()) <= 1
        assert not torch.equal(step.predicted, step.target)


def test_nothing_is_recorded_without_steering(
    completer: SteeredCompleter, frame: PreparedFrame
) -> None:
    unsteered = SteeredCompleter(completer.pipeline, "tiny", preset=None)
    assert not record_steering(unsteered, frame, generator=torch.Generator())


def test_is_drawn_for_the_first_method_that_steers(
    completer: SteeredCompleter, tiny: RunSettings, tmp_path: Path
) -> None:
    replace(tiny, methods=("linear", "paper")).save(tmp_path)
    paths = draw_figures(
        tmp_path,
        tmp_path / "figures",
        create=lambda name: completer if name == "paper" else create_method(name),
    )
    assert paths[-1].name == "steering.png"
    with Image.open(paths[-1]) as picture:
        assert picture.width > picture.height
