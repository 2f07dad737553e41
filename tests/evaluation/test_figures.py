from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from PIL import Image

from steered_marigold.errors import InputError
from steered_marigold.evaluation.figures import areas_figure, comparison_figure, draw_figures
from steered_marigold.evaluation.pictures import complete_examples, sparse_picture, truth_picture
from steered_marigold.evaluation.protocol import Protocol
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.methods.protocol import DepthCompleter

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
    paths = draw_figures(paper, tmp_path / "figures")
    assert [path.name for path in paths] == ["completion.png", "comparison.png", "areas.png"]
    for path in paths:
        with Image.open(path) as picture:
            assert np.asarray(picture).std() > 5


def test_other_protocols_have_no_areas(tiny: RunSettings, tmp_path: Path) -> None:
    paths = draw_figures(tiny, tmp_path, frame_id="f1")
    assert [path.name for path in paths] == ["completion.png", "comparison.png"]


def test_areas_are_centred(paper: RunSettings) -> None:
    figure = areas_figure(Evaluator(paper).prepare("a"))
    boxes = [patch.get_bbox() for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]
    assert [(box.width, box.height) for box in boxes] == [(608, 448), (408, 248), (358, 198)]
    for box in boxes:
        assert ((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2) == (303.5, 223.5)


def test_a_failing_method_leaves_its_place_empty(tiny: RunSettings, failing_on: Factories) -> None:
    evaluator = Evaluator(tiny, failing_on(tiny.path / "rgb" / "f1.png"))
    answers = complete_examples(evaluator, ("wrapped", "linear"), ("f0", "f1"))
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
    drawn, mask = sparse_picture(frame), frame.measurements.valid_mask.numpy()
    np.testing.assert_array_equal(drawn[mask], frame.measurements.sparse_depth.numpy()[mask])
    assert (np.isfinite(drawn).sum() > mask.sum()) == enlarged
    np.testing.assert_array_equal(truth_picture(frame), frame.depth.numpy())


def test_bad_input(tiny: RunSettings, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="frame 'f9' is not in the run"):
        draw_figures(tiny, tmp_path, frame_id="f9")
    with pytest.raises(InputError, match="no method of the run could complete frame f2"):
        draw_figures(replace(tiny, methods=("bpnet",)), tmp_path)
