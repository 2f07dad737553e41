"""Time, memory, tables and files of the benchmarks."""

import json
from pathlib import Path

import pytest
import torch

from benchmarks.measuring import (
    Timing,
    describe,
    idle_machine,
    markdown_table,
    measure,
    measure_interleaved,
    ratio_cell,
    write_json,
)


def test_works_alternate_and_warm_up_is_not_timed() -> None:
    order: list[str] = []
    works = {"a": lambda: order.append("a"), "b": lambda: order.append("b")}
    timings = measure_interleaved(works, warm_up=1, repeats=2)
    assert order == ["a", "b"] * 3
    assert all(len(timing.seconds) == 2 for timing in timings.values())


def test_memory_that_a_work_takes_and_frees_is_seen() -> None:
    timing = measure(lambda: torch.ones(64, 2**20, dtype=torch.uint8), repeats=1)
    assert 60 < timing.peak_mib < 80


def test_median_and_spread_of_a_timing() -> None:
    assert Timing((3.0, 1.0, 2.0), 10.4).cells == ("2", "1 to 3", "10")


def test_a_ratio_is_that_of_the_medians() -> None:
    slow, fast = Timing((9.0, 4.0, 3.0), 0), Timing((1.0, 2.0, 50.0), 0)
    assert fast.times_faster(slow) == 2
    assert ratio_cell(slow, fast) == "0.5"
    assert ratio_cell(fast, None) == ""


def test_a_busy_machine_is_refused_unless_forced_which_the_record_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.getloadavg", lambda: (0.31, 0.0, 0.0))
    with pytest.raises(SystemExit, match=r"the load is 0\.31.*--force"):
        idle_machine(2, force=False, patience_s=0)
    record = idle_machine(2, force=True)
    assert (record["load_at_start"], record["forced"], record["threads"]) == (0.31, True, 2)
    assert "load 0.31 at the start, busy machine (--force)" in describe(record)


def test_an_idle_machine_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    loads = iter([2.0, 0.9, 0.1])
    monkeypatch.setattr("os.getloadavg", lambda: (next(loads), 0.0, 0.0))
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    record = idle_machine(1, force=False)
    assert (record["load_at_start"], record["forced"]) == (0.1, False)
    assert "busy" not in describe(record)


def test_a_table_is_markdown() -> None:
    assert markdown_table(("a", "b"), [(1, "x")]) == "| a | b |\n| --- | --- |\n| 1 | x |"


def test_json_holds_dataclasses_and_replaces_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "result.json"
    for peak in (1.0, 2.0):
        write_json(path, {"stage": {"unet": Timing((0.5,), peak)}})
    assert json.loads(path.read_text())["stage"]["unet"] == {"seconds": [0.5], "peak_mib": 2.0}
    assert list(path.parent.iterdir()) == [path]
    assert str(path) in capsys.readouterr().out
