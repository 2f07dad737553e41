from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.evaluation.predictions import Predictions
from steered_marigold.evaluation.report import write_outputs
from steered_marigold.evaluation.runner import Evaluator, run_evaluation
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method

LABEL = "paper@steering_strength=0.2,condition_alignment=minmax"
names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20)


def no_method(name: str) -> DepthCompleter:
    raise AssertionError(f"{name} was asked for again")


class Counting:
    """`create_method`, and how many completions there were."""

    def __init__(self) -> None:
        self.completions = 0

    def __call__(self, name: str) -> DepthCompleter:
        method, outer = create_method(name), self

        class Counted(DepthCompleter):
            name = method.name

            def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
                outer.completions += 1
                return method.answer(frame, generator=generator)

        return Counted()


@pytest.mark.parametrize(
    ("dataset", "step", "farthest"), [("folder", 1e-3, 65.5), ("kitti", 1 / 256, 255.9)]
)
def test_what_is_kept_is_read(
    tiny: RunSettings, tmp_path: Path, dataset: str, step: float, farthest: float
) -> None:
    kept = Predictions(replace(tiny, dataset=dataset), tmp_path)
    depth = 0.1 + 60 * torch.rand(20, 30, generator=torch.Generator().manual_seed(0))
    depth[0, :3] = torch.tensor([-1.0, 0.0, 1e4])
    kept.write(LABEL, "0042", depth)
    again = kept.read(LABEL, "0042")
    assert again is not None
    assert again.flatten()[3:].tolist() == pytest.approx(
        depth.flatten()[3:].tolist(), abs=step / 2 + 1e-5
    )
    assert again[0, :2].tolist() == [0, 0]
    assert float(again[0, 2]) == pytest.approx(farthest, abs=0.1)
    assert [path.name for path in kept.path(LABEL, "0042").parent.iterdir()] == ["0042.png"]


def test_what_is_absent_or_damaged_is_none(tiny: RunSettings, tmp_path: Path) -> None:
    kept = Predictions(tiny, tmp_path)
    assert kept.read("linear", "0042") is None
    kept.write("linear", "0042", torch.ones(4, 4))
    path = kept.path("linear", "0042")
    path.write_bytes(path.read_bytes()[:40])
    assert kept.read("linear", "0042") is None


@given(names, names, names, names)
def test_names_are_safe_and_tell_answers_apart(a: str, b: str, c: str, d: str) -> None:
    root = Path("run")
    settings = RunSettings.__new__(RunSettings)
    object.__setattr__(settings, "dataset", "folder")
    kept = Predictions(settings, root)
    path = kept.path(a, b)
    assert path.relative_to(root / "predictions").parts == (path.parent.name, path.name)
    assert not set(path.name + path.parent.name) & set('<>:"/\\|?*')
    assert (path == kept.path(c, d)) == ((a, b) == (c, d))


def test_labels_stay_readable(tiny: RunSettings, tmp_path: Path) -> None:
    kept = Predictions(tiny, tmp_path)
    assert kept.path(LABEL, "drive/1").parent.name == LABEL
    assert kept.path(f"stream:{LABEL}", "drive/1").parent.name == f"stream%3A{LABEL}"


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_keeps_every_answer(tiny: RunSettings, tmp_path: Path, workers: int) -> None:
    run_evaluation(tiny, tmp_path, engine=LocalEngine(workers=workers))
    evaluator = Evaluator(tiny)
    for label in tiny.methods:
        for frame_id in tiny.frames:
            kept = Predictions(tiny, tmp_path).read(label, frame_id)
            answer = evaluator.complete(label, evaluator.prepare(frame_id)).depth[0]
            assert kept is not None
            assert float((kept - answer).abs().max()) <= 0.00051


def test_the_report_completes_nothing_again(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(tiny, tmp_path)
    write_outputs(run, tmp_path, create=no_method)
    assert "data:image/jpeg" in (tmp_path / "report.html").read_text()


def test_the_report_completes_what_is_missing(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(tiny, tmp_path)
    Predictions(tiny, tmp_path).path("linear", "f2").unlink()
    create = Counting()
    write_outputs(run, tmp_path, create=create)
    assert create.completions == 1


def test_none_are_kept_on_request(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(tiny, tmp_path, keep_predictions=False)
    assert not (tmp_path / "predictions").exists()
    create = Counting()
    write_outputs(run, tmp_path, create=create)
    assert create.completions == 2 * 4  # two worst and two best frames, two methods


def test_overwriting_forgets_the_old_answers(tiny: RunSettings, tmp_path: Path) -> None:
    run_evaluation(tiny, tmp_path)
    fewer = replace(tiny, frames=tiny.frames[:1], seed=1)
    run_evaluation(fewer, tmp_path, overwrite=True)
    assert Predictions(tiny, tmp_path).read("linear", "f0") is not None
    assert Predictions(tiny, tmp_path).read("linear", "f1") is None


def test_an_image_that_failed_keeps_nothing(
    tiny: RunSettings, tmp_path: Path, failing_on: Callable[[Path], Callable[[str], DepthCompleter]]
) -> None:
    settings = replace(tiny, methods=("wrapped",))
    run_evaluation(settings, tmp_path, create=failing_on(tiny.path / "rgb" / "f1.png"))
    kept = Predictions(settings, tmp_path)
    assert [kept.read("wrapped", frame) is None for frame in tiny.frames] == [
        False,
        True,
        False,
        False,
    ]
