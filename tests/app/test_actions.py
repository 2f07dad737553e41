"""What the page's controls do, on a tiny random checkpoint."""

import json
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import torch

from steered_marigold.app.actions import Actions, Limits, Run, painted
from steered_marigold.app.running import Models, StoppedError
from steered_marigold.app.sessions import Session, Sessions
from steered_marigold.errors import InputError
from steered_marigold.frames.complete import complete_frame
from steered_marigold.frames.sources import Reading
from steered_marigold.methods.steered import SteeredCompleter
from tests.app.test_inputs import write_frame
from tests.diffusion.conftest import tiny_pipeline

RUN = Run("tiny", "fast", 0.0, 3)


def ignore(done: int, total: int) -> None:
    """Of the steps."""


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Models:
    folder = tmp_path_factory.mktemp("tiny")
    tiny_pipeline().save_pretrained(folder)
    return Models({"tiny": str(folder)}, device="cpu")


@pytest.fixture
def actions(models: Models) -> Actions:
    return Actions(models, Limits())


@pytest.fixture
def session(tmp_path: Path, actions: Actions) -> Session:
    """With an uploaded frame of 48x64 pixels."""
    session = Sessions(tmp_path / "sessions", most=2).of("me")
    files = write_frame(tmp_path / "mine", "f1", (48, 64))
    shown = actions.upload(session, Reading(), depth=[str(files.depth)])
    assert "image" in shown.view["empty"]
    actions.upload(session, Reading(), image=str(files.image))
    session.stop.clear()  # as the page does when a run begins
    return session


def test_it_is_the_completion_that_every_front_end_gets(
    actions: Actions, session: Session, models: Models
) -> None:
    assert session.frame is not None
    actions.complete(session, RUN, ignore)
    assert session.completed is not None
    _, completion, record = session.completed
    completer = models.completer("tiny", preset="fast", steering_strength=0.0)
    again, _ = complete_frame(completer, session.frame, seed=3)
    assert torch.equal(completion.depth, again.depth)
    assert record.values["seed"] == 3


def test_steps_are_counted_up_to_their_number(actions: Actions, session: Session) -> None:
    told: list[tuple[int, int]] = []
    run = Run("tiny", "paper", 0.1, 0)
    actions.complete(session, run, lambda done, total: told.append((done, total)))
    assert told == [(done, 50) for done in range(51)]


def test_a_run_ends_within_a_step_of_being_cancelled(actions: Actions, session: Session) -> None:
    told: list[int] = []

    def stop_at_three(done: int, total: int) -> None:
        told.append(done)
        if done == 3:
            thread = Thread(target=session.stop.set)
            thread.start()
            thread.join()

    session.stop.clear()
    with pytest.raises(StoppedError, match="Cancelled"):
        actions.complete(session, Run("tiny", "paper", 0.1, 0), stop_at_three)
    assert told == [0, 1, 2, 3]
    assert session.completed is None


def test_a_run_that_takes_too_long_ends(models: Models, session: Session) -> None:
    brief = Actions(models, Limits(seconds=0.0))
    session.stop.clear()
    with pytest.raises(StoppedError, match="Stopped after 0 s"):
        brief.complete(session, RUN, ignore)


def test_a_frame_opened_meanwhile_wins(actions: Actions, session: Session) -> None:
    session.stop.clear()

    def open_another(done: int, total: int) -> None:
        if done == total:
            actions.open_sample(session, "Room")

    with pytest.raises(StoppedError, match="Another frame"):
        actions.complete(session, RUN, open_another)
    assert session.completed is None
    assert session.frame is not None
    assert session.frame.size == (480, 640)


def test_what_is_erased_is_not_given_and_is_compared(actions: Actions, session: Session) -> None:
    session.stop.clear()
    with pytest.raises(InputError, match="Nothing is painted"):
        actions.erase(session, "[]")
    with pytest.raises(InputError, match="Every measurement"):
        actions.erase(session, "[[32, 24, 99]]")
    actions.erase(session, "[[20, 40, 6]]")
    shown = actions.complete(session, RUN, ignore)
    assert session.completed is not None
    assert session.frame is not None
    given = session.completed[0]
    assert not given.valid_mask[40, 20]
    assert session.frame.valid_mask[40, 20]
    assert "erased pixels" in shown.facts
    actions.restore(session)
    assert "erased pixels" not in actions.complete(session, RUN, ignore).facts


def test_discs_are_where_they_were_painted() -> None:
    mask = painted("[[10, 5, 3], [30, 15, 0]]", (20, 40)).numpy()
    y, x = np.mgrid[:20, :40]
    distance = np.hypot(x - 10, y - 5)
    assert mask[distance <= 2].all()
    assert not mask[(distance > 5) & (np.hypot(x - 30, y - 15) > 2)].any()
    for wrong in ("", "{}x", "[[1, 2]]", '[["a", 1, 2]]', "7"):
        with pytest.raises(InputError, match="strokes"):
            painted(wrong, (20, 40))


def test_the_files_of_a_result_are_all_there(actions: Actions, session: Session) -> None:
    with pytest.raises(InputError, match="no result yet"):
        actions.downloads(session)
    session.stop.clear()
    actions.complete(session, RUN, ignore)
    files = actions.downloads(session)
    assert set(files) == {"depth.png", "depth.npy", "depth.exr", "uncertainty", "record"}
    assert all(path.is_relative_to(session.folder) for path in files.values())
    record = json.loads(files["record"].read_text())
    assert record["frame"] == "f1"
    _, distance, note = actions.mesh(session, 10.0)
    assert distance > 0
    assert "camera is not known" in note


def test_without_a_depth_map_depth_is_relative(actions: Actions, tmp_path: Path) -> None:
    session = Sessions(tmp_path / "s", most=2).of("me")
    files = write_frame(tmp_path / "mine", "f1", (48, 64))
    actions.upload(session, Reading(no_measurements=True), image=str(files.image))
    session.stop.clear()
    shown = actions.complete(session, RUN, ignore)
    assert "relative" in shown.facts
    assert shown.view["unit"] == "relative"
    with pytest.raises(InputError, match="no metres"):
        actions.mesh(session, None)


def test_files_of_a_sample_and_uploads_are_not_mixed(actions: Actions, session: Session) -> None:
    actions.open_sample(session, "Room")
    assert session.depth is not None
    assert not session.depth.is_relative_to(session.folder)
    depth = session.folder / "depth" / "f1.png"
    shown = actions.upload(session, Reading(), depth=[str(depth)])
    assert "empty" in shown.view
    assert session.image is None


def test_the_method_is_recorded_steered_and_not(
    actions: Actions, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.stop.clear()
    told: list[tuple[int, int]] = []
    view = actions.method(session, RUN, lambda done, total: told.append((done, total)))
    assert told[-1] == (100, 100)
    assert told[51] == (50, 100)
    assert view["steps"] == 50
    titles = [answer["title"] for answer in view["answers"]]
    assert titles == ["Steered", "Not steered", "Linear interpolation"]
    assert len({str(answer["bar"]) for answer in view["answers"]}) == 1
    assert len({answer["src"] for answer in view["answers"]}) == 3
    early, late = view["directions"]
    assert early["title"].startswith("Early step, t = 981")
    assert late["title"].startswith("Late step, t = 1")
    steered, unsteered = view["films"]
    times = [picture["t"] for picture in steered["frames"]]
    assert times == sorted(times, reverse=True)
    assert len(times) == 8
    assert steered["frames"][-1]["src"] != unsteered["frames"][-1]["src"]


def test_the_strength_is_the_presets_unless_it_is_changed(models: Models) -> None:
    assert not models.completer("tiny", preset="fast", steering_strength=0.0).steers
    completer = models.completer("tiny", preset="fast", steering_strength=0.3)
    assert isinstance(completer, SteeredCompleter)
    assert completer.steers
