from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.patches import Rectangle
from PIL import Image

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.evaluation.calibration_figure import calibration_figure, kept_curves
from steered_marigold.evaluation.figures import areas_figure, comparison_figure, draw_figures
from steered_marigold.evaluation.pictures import example_answers, sparse_picture, truth_picture
from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.runner import Evaluator, run_evaluation
from steered_marigold.evaluation.seam_figure import seam_figure
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.methods.completer import DepthCompleter

Factories = Callable[[Path], Callable[[str], DepthCompleter]]


@pytest.fixture
def paper(tiny: RunSettings, tmp_path: Path) -> RunSettings:
    """One frame of 640x480 px under paper-erased, with a method that has no weights."""
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(tmp_path / "rgb" / "a.png")
    ramp = np.tile(np.linspace(1000, 4000, 640).astype(np.uint16), (480, 1))
    Image.fromarray(ramp).save(tmp_path / "depth" / "a.png")
    return replace(
        tiny,
        path=tmp_path,
        protocol=Protocol(kind="paper-erased"),
        methods=("nearest", "bpnet"),
        frames=("a",),
    )


def test_draws_the_papers_figures(paper: RunSettings, tmp_path: Path) -> None:
    paper.save(tmp_path)
    paths = draw_figures(tmp_path, tmp_path / "figures")
    names = ["completion.png", "comparison.png", "areas.png", "seam.png"]
    assert [path.name for path in paths] == names
    for path in paths:
        with Image.open(path) as picture:
            assert np.asarray(picture).std() > 5


def test_other_protocols_have_no_areas_and_no_seam(tiny: RunSettings, tmp_path: Path) -> None:
    tiny.save(tmp_path)
    paths = draw_figures(tmp_path, tmp_path / "figures", frame_id="f1")
    assert [path.name for path in paths] == ["completion.png", "comparison.png"]


def test_kept_answers_are_drawn_and_not_completed_again(
    tiny: RunSettings, tmp_path: Path, failing_on: Factories
) -> None:
    settings = replace(
        tiny, methods=("wrapped",), frames=("f0", "f2"), protocol=Protocol(kind="objects")
    )
    run_evaluation(settings, tmp_path, create=failing_on(tiny.path / "rgb" / "f1.png"))

    def nothing(name: str) -> DepthCompleter:
        raise AssertionError(name)

    paths = draw_figures(tmp_path, tmp_path / "figures", create=nothing)
    names = ["completion.png", "comparison.png", "seam.png", "calibration.png"]
    assert [path.name for path in paths] == names


def test_calibration_is_the_mean_over_images(
    tiny: RunSettings, tmp_path: Path, failing_on: Factories
) -> None:
    settings = replace(tiny, methods=("wrapped", "linear"))
    run = run_evaluation(settings, tmp_path, create=failing_on(tiny.path / "rgb" / "f1.png"))
    curves = kept_curves(tmp_path, settings)
    assert list(curves) == ["wrapped"]
    images = [x.curves for x in run.results["wrapped"] if x.curves is not None]
    assert len(images) == 3
    for name in ("coverage", "by_uncertainty", "by_error"):
        expected = np.mean([image[name] for image in images], axis=0)
        assert getattr(curves["wrapped"], name) == pytest.approx(tuple(expected))
    figure = calibration_figure(curves, "hidden")
    assert figure is not None
    assert len(figure.axes[0].lines) == 2
    assert calibration_figure({}, "hidden") is None


def test_seam_is_drawn_where_the_hole_is(paper: RunSettings) -> None:
    evaluator = Evaluator(paper)
    frame = evaluator.prepare("a")
    figure = seam_figure(frame, example_answers(evaluator, ("nearest",), ("a",))["a"])
    assert figure is not None
    whole, near = figure.axes
    assert whole.get_title() == "row 224"
    left, right = near.get_xlim()
    assert left < 100 < right
    assert [line.get_label() for line in whole.lines] == ["truth", "nearest"]
    np.testing.assert_array_equal(whole.lines[0].get_ydata(), frame.metric_depth[224].numpy())
    assert seam_figure(replace(frame, known_area=None), {}) is None
    assert (
        seam_figure(replace(frame, known_area=torch.ones(448, 608, dtype=torch.bool)), {}) is None
    )


def test_areas_are_centred(paper: RunSettings) -> None:
    figure = areas_figure(Evaluator(paper).prepare("a"))
    boxes = [patch.get_bbox() for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]
    assert [(box.width, box.height) for box in boxes] == [(608, 448), (408, 248), (358, 198)]
    for box in boxes:
        assert ((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2) == (303.5, 223.5)


def test_a_failing_method_leaves_its_place_empty(tiny: RunSettings, failing_on: Factories) -> None:
    evaluator = Evaluator(tiny, failing_on(tiny.path / "rgb" / "f1.png"))
    answers = example_answers(evaluator, ("wrapped", "linear"), ("f0", "f1"))
    assert {frame: set(methods) for frame, methods in answers.items()} == {
        "f0": {"wrapped", "linear"},
        "f1": {"linear"},
    }
    shown = {frame: (evaluator.prepare(frame), answers[frame]) for frame in ("f0", "f1")}
    titles = [axes.get_title() for axes in comparison_figure(shown).axes]
    assert titles[:6] == ["f0", "wrapped", "linear", "f1", "", "linear"]


@pytest.mark.parametrize(("lines", "enlarged"), [(1, True), (8, False)])
def test_pictures_show_what_is_known(tiny: RunSettings, lines: int, enlarged: bool) -> None:
    settings = replace(tiny, protocol=Protocol(kind="lidar", lines=lines))
    frame = Evaluator(settings).prepare("f2")
    drawn, mask = sparse_picture(frame), frame.shown.valid_mask.numpy()
    np.testing.assert_array_equal(drawn[mask], frame.shown.sparse_depth.numpy()[mask])
    assert (np.isfinite(drawn).sum() > mask.sum()) == enlarged
    np.testing.assert_array_equal(truth_picture(frame), frame.metric_depth.numpy())


def test_bad_input(tiny: RunSettings, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"run\.json: no such file"):
        draw_figures(tmp_path, tmp_path)
    replace(tiny, methods=("bpnet",)).save(tmp_path)
    with pytest.raises(InputError, match="frame 'f9' is not in the run"):
        draw_figures(tmp_path, tmp_path, frame_id="f9")
    with pytest.raises(InputError, match="no method of the run could complete frame f2"):
        draw_figures(tmp_path, tmp_path)
