from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.core.metrics import depth_errors, seam_step
from steered_marigold.errors import (
    CheckpointError,
    FileFormatError,
    InputError,
    SizeMismatchError,
)
from steered_marigold.evaluation.protocols import Protocol, prepare
from steered_marigold.evaluation.results import ImageResult, ResultLog
from steered_marigold.evaluation.runner import Evaluator, Run, run_evaluation
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.evaluation.summary import summarize
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.registry import create_method
from steered_marigold.methods.steered import SteeredCompleter
from tests.diffusion.conftest import tiny_pipeline

Factory = Callable[[str], DepthCompleter]


def figures(run: Run) -> list[dict[str, Any]]:
    """The rows of the summary without what depends on the clock."""
    rows: list[dict[str, Any]] = summarize(run)["rows"]
    return [{key: row[key] for key in row if key != "seconds_per_image"} for row in rows]


def test_errors_are_those_of_the_method_on_the_frame(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(tiny, tmp_path)
    assert list(run.results) == ["nearest", "linear"]
    assert [result.frame_id for result in run.results["linear"]] == list(tiny.frames)
    sample = tiny.open_dataset().load("f2")
    frame = prepare(sample, tiny.protocol, seed=0)
    answer = create_method("linear").answer(frame.shown)
    expected = depth_errors(answer.depth[0], sample.metric_depth, ~frame.shown.valid_mask)
    result = run.results["linear"][2]
    assert result.areas["hidden"]["abs_rel"] == expected.abs_rel
    assert result.areas["hidden"]["valid_pixels"] == 32 * 40 - 8 * 40
    assert result.areas["measured"]["abs_rel"] == 0
    assert (result.trusted_fraction, result.max_deviation_m) == (1, 0)


@pytest.mark.parametrize("stop_after", [1, 3, 7])
def test_a_stopped_run_resumes_to_the_same_figures(
    tiny: RunSettings, tmp_path: Path, stop_after: int
) -> None:
    whole = run_evaluation(tiny, tmp_path / "whole")

    def stop(result: ImageResult, done: int, total: int) -> None:
        if done == stop_after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_evaluation(tiny, tmp_path / "stopped", on_result=stop)
    log = tmp_path / "stopped" / "results.jsonl"
    assert len(log.read_bytes().splitlines()) == stop_after
    with log.open("ab") as file:  # as if killed while writing
        file.write(b'{"method": "linear", "frame_')
    counts: list[tuple[int, int]] = []
    resumed = run_evaluation(
        tiny,
        tmp_path / "stopped",
        on_result=lambda result, done, total: counts.append((done, total)),
    )
    assert counts == [(done, 8) for done in range(stop_after + 1, 9)]
    assert figures(resumed) == figures(whole)
    assert figures(run_evaluation(tiny, tmp_path / "stopped")) == figures(whole)


def test_workers_and_order_change_nothing(tiny: RunSettings, tmp_path: Path) -> None:
    one = run_evaluation(tiny, tmp_path / "one")
    two = run_evaluation(tiny, tmp_path / "two", engine=LocalEngine(workers=2))
    assert two.threads_per_worker == max(1, torch.get_num_threads() // 2)
    assert figures(one) == figures(two)
    swapped = run_evaluation(replace(tiny, methods=("linear", "nearest")), tmp_path / "swapped")
    assert sorted(figures(swapped), key=repr) == sorted(figures(one), key=repr)


def test_frames_and_methods_may_be_added(tiny: RunSettings, tmp_path: Path) -> None:
    small = replace(tiny, methods=("nearest",), frames=tiny.frames[:2])
    assert len(run_evaluation(small, tmp_path).results["nearest"]) == 2
    done: list[str] = []
    grown = run_evaluation(tiny, tmp_path, on_result=lambda result, *_: done.append(result.method))
    assert (done.count("nearest"), done.count("linear")) == (2, 4)
    assert figures(grown) == figures(run_evaluation(tiny, tmp_path / "at once"))


def test_shards_of_a_run_add_up_exactly(tiny: RunSettings, tmp_path: Path) -> None:
    """Frames in two folders, their results in one, in any order: the figures of the whole."""
    whole = run_evaluation(tiny, tmp_path / "whole")
    lines: list[bytes] = []
    for name, frames in (("a", ("f3", "f1")), ("b", ("f0", "f2"))):
        run_evaluation(replace(tiny, frames=frames), tmp_path / name)
        lines += (tmp_path / name / "results.jsonl").read_bytes().splitlines(keepends=True)
    tiny.save(tmp_path)
    (tmp_path / "results.jsonl").write_bytes(b"".join(reversed(lines)))
    merged = run_evaluation(tiny, tmp_path, on_result=lambda *_: pytest.fail("done again"))
    assert figures(merged) == figures(whole)


def test_seam_and_curves_are_recorded_where_they_exist(
    tiny: RunSettings, tmp_path: Path, failing_on: Callable[[Path], Factory]
) -> None:
    settings = replace(tiny, protocol=Protocol(kind="objects"), methods=("nearest", "wrapped"))
    run = run_evaluation(settings, tmp_path / "a", create=failing_on(tiny.path / "rgb" / "f1.png"))
    frame = Evaluator(settings).prepare("f2")
    assert frame.known_area is not None
    answer = Evaluator(settings).complete("nearest", frame)
    expected = seam_step(answer.depth[0], frame.metric_depth, frame.areas["full"], frame.known_area)
    assert run.results["nearest"][2].seam_step == expected
    assert run.results["nearest"][2].curves is None
    curves = run.results["wrapped"][2].curves
    assert curves is not None
    assert set(curves) == {"coverage", "by_uncertainty", "by_error"}
    row = next(row for row in figures(run) if (row["method"], row["area"]) == ("nearest", "full"))
    seams = [x.seam_step for x in run.results["nearest"] if x.seam_step is not None]
    assert row["seam_step"] == pytest.approx(sum(seams) / len(seams))
    lidar = run_evaluation(tiny, tmp_path / "b")
    assert all(x.seam_step is None for x in lidar.results["nearest"])
    assert "seam_step" not in figures(lidar)[0]


def test_another_run_in_the_folder_is_refused(tiny: RunSettings, tmp_path: Path) -> None:
    run_evaluation(tiny, tmp_path)
    other = replace(tiny, seed=1, protocol=Protocol(kind="lidar", lines=4))
    with pytest.raises(
        InputError,
        match=r"another protocol, seed; ",
    ):
        run_evaluation(other, tmp_path)
    assert run_evaluation(other, tmp_path, overwrite=True).settings.seed == 1
    assert run_evaluation(other, tmp_path).settings.seed == 1


def test_a_failing_image_is_counted_and_tried_again(
    tiny: RunSettings, tmp_path: Path, failing_on: Callable[[Path], Factory]
) -> None:
    settings = replace(tiny, methods=("wrapped", "linear"))
    create = failing_on(tiny.path / "rgb" / "f1.png")
    run = run_evaluation(settings, tmp_path, create=create)
    assert [(x.method, x.frame_id) for x in run.failures] == [("wrapped", "f1")]
    assert "out of ideas" in str(run.failures[0].error)
    rows = {(row["method"], row["area"]): row for row in figures(run)}
    assert (rows["wrapped", "full"]["images"], rows["wrapped", "full"]["failed"]) == (3, 1)
    assert (rows["linear", "full"]["images"], rows["linear", "full"]["failed"]) == (4, 0)
    answered = [x.areas["full"]["mae_m"] for x in run.results["wrapped"] if not x.error]
    assert rows["wrapped", "full"]["mae_m"] == pytest.approx(np.mean(answered))
    again: list[str] = []
    mended = run_evaluation(
        settings,
        tmp_path,
        create=failing_on(tiny.path / "rgb" / "f0.png"),
        on_result=lambda result, *_: again.append(result.frame_id),
    )
    assert again == ["f1"]
    assert not mended.failures


def test_uncertainty_and_trust_are_recorded(
    tiny: RunSettings, tmp_path: Path, failing_on: Callable[[Path], Factory]
) -> None:
    settings = replace(tiny, methods=("wrapped",), frames=("f0",))
    create = failing_on(tiny.path / "rgb" / "f1.png")
    (row, *_) = summarize(run_evaluation(settings, tmp_path, create=create))["rows"]
    assert row["area"] == "full"
    assert 0 < row["coverage90"] < 1
    assert row["spearman"] == 0  # a constant uncertainty tells nothing
    assert row["ause"] > 0
    assert row["trusted_fraction"] == 0.5
    assert row["max_deviation_m"] == 0


def test_every_method_draws_the_same_numbers_of_a_frame(
    tiny: RunSettings, failing_on: Callable[[Path], Factory]
) -> None:
    evaluator = Evaluator(tiny, failing_on(tiny.path / "rgb" / "f3.png"))
    method: Any = evaluator.method("wrapped")
    for frame_id in ("f0", "f1", "f0"):
        assert evaluator.evaluate("wrapped", frame_id).error is None
    assert method.draws[0] == method.draws[2] != method.draws[1]


def test_methods_without_weights_are_left_out(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(replace(tiny, methods=("bpnet", "nearest")), tmp_path)
    assert list(run.results) == ["nearest"]
    assert "weights" in run.left_out["bpnet"]
    with pytest.raises(CheckpointError, match=r"no method can run: bpnet"):
        run_evaluation(replace(tiny, methods=("bpnet",)), tmp_path / "none")


def test_wrong_names_are_told_before_any_work(tiny: RunSettings, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'nearst'"):
        run_evaluation(replace(tiny, methods=("linear", "nearst")), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_frames_smaller_than_the_papers_crop_fail(tiny: RunSettings, tmp_path: Path) -> None:
    run = run_evaluation(replace(tiny, protocol=Protocol(kind="paper-erased")), tmp_path)
    assert len(run.failures) == 8
    assert "608x448" in str(run.failures[0].error)
    with pytest.raises(SizeMismatchError):
        Evaluator(replace(tiny, protocol=Protocol(kind="paper-erased"))).prepare("f0")
    assert {row["abs_rel"] for row in figures(run)} == {None}


def test_settings_survive_their_file(tiny: RunSettings, tmp_path: Path) -> None:
    settings = replace(
        tiny,
        protocol=Protocol(kind="sensor", masks=tmp_path, noise=0.1),
        weights={"bpnet": tmp_path / "b.pth"},
        dtype="bfloat16",
    )
    settings.save(tmp_path)
    assert RunSettings.load(tmp_path) == settings
    with pytest.raises(FileFormatError, match=r"run\.json: no such file"):
        RunSettings.load(tmp_path / "absent")
    (tmp_path / "run.json").write_text('{"dataset": "folder"}')
    with pytest.raises(FileFormatError, match=r"run\.json: damaged"):
        RunSettings.load(tmp_path)


def test_each_method_says_what_it_ran_as(tiny: RunSettings, tmp_path: Path) -> None:
    settings = replace(tiny, methods=("nearest", "paper@num_inference_steps=2"), frames=("f0",))
    pipeline = tiny_pipeline()

    def create(name: str) -> DepthCompleter:
        if name == "nearest":
            return create_method(name)
        return SteeredCompleter(pipeline, "tiny", preset="paper", num_inference_steps=2)

    run = run_evaluation(settings, tmp_path, create=create)
    assert not run.failures
    assert run.described["nearest"] == {"method": "nearest", "steers": False}
    assert run.described["paper@num_inference_steps=2"] == {
        "method": "paper",
        "steers": True,
        "checkpoint": "tiny",
        "preset": "paper",
        "steps": 2,
        "device": "cpu",
        "dtype": "float32",
    }
    runs_as = {row["method"]: row["runs_as"] for row in figures(run)}
    assert runs_as == {"nearest": "", "paper@num_inference_steps=2": "steers, float32, cpu"}
    assert summarize(run)["run"]["methods"] == run.described


def test_log_reads_what_it_wrote(tmp_path: Path) -> None:
    log = ResultLog(tmp_path / "log.jsonl")
    assert log.read() == {}
    first = ImageResult(method="a", frame_id="1", areas={"full": {"irmse_per_km": float("inf")}})
    log.append(ImageResult(method="a", frame_id="1", areas={}, error="no"))
    log.append(first)
    assert log.read() == {("a", "1"): first}
    log.path.write_text("nonsense\n")
    with pytest.raises(FileFormatError, match="not a log"):
        log.read()
