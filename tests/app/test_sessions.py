"""What is remembered of visitors, and that it is forgotten."""

import time
from pathlib import Path

import pytest

from steered_marigold.app import sessions
from steered_marigold.app.sessions import Sessions


def test_each_visitor_has_a_folder_of_its_own_that_ends_with_the_visit(tmp_path: Path) -> None:
    visitors = Sessions(tmp_path / "s", most=5)
    first, second = visitors.of("a"), visitors.of("b")
    assert visitors.of("a") is first
    assert first.folder != second.folder
    assert (first.folder.stat().st_mode & 0o077) == 0
    upload = tmp_path / "upload.png"
    upload.write_text("x")
    kept = first.keep(upload, "image")
    assert kept.is_relative_to(first.folder)
    assert not upload.exists()
    assert first.keep(kept, "image") == kept
    upload.write_text("y")
    assert first.keep(upload, "depth") != kept
    assert kept.read_text() == "x"
    visitors.close("a")
    assert not first.folder.exists()
    assert first.stop.is_set()
    assert second.folder.exists()
    assert not second.stop.is_set()
    visitors.close("a")  # twice, or never opened: nothing happens


def test_the_least_recent_visitor_makes_room(tmp_path: Path) -> None:
    visitors = Sessions(tmp_path, most=2)
    a, b = visitors.of("a"), visitors.of("b")
    visitors.of("a")
    c = visitors.of("c")
    assert len(visitors) == 2
    assert a.folder.exists()
    assert not b.folder.exists()
    assert c.folder.exists()


def test_idle_visitors_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    visitors = Sessions(tmp_path, most=9)
    idle = visitors.of("idle")
    monkeypatch.setattr(sessions, "IDLE_S", 0.01)
    time.sleep(0.02)
    visitors.of("new")
    assert not idle.folder.exists()
    assert len(visitors) == 1
