"""What a user waits for."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.waiting import frame_table, present, time_command, time_frames


def test_a_command_that_fails_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="steered-marigold failed"):
        time_command(["no-such-command"], repeats=1, threads=1)


def test_a_command_is_timed_with_its_whole_memory() -> None:
    timing = time_command(["--help"], repeats=1, threads=1)
    assert timing.peak_mib > 10
    assert timing.seconds[0] > 0


def test_the_process_that_starts_others_stays_small() -> None:
    code = "import benchmarks.waiting, sys; print('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"


def test_a_sensor_frame_that_is_absent_is_told_and_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert present(tmp_path) == [tmp_path]
    assert present(tmp_path / "absent") == []
    assert "absent is not on this machine" in capsys.readouterr().out


@pytest.mark.slow
def test_the_sample_is_completed_in_a_process_of_its_own(tmp_path: Path) -> None:
    rows = time_frames(tmp_path / "absent", repeats=1, threads=1)
    assert [(row["preset"], row["measurements"]) for row in rows] == [
        ("default", 13_620),
        ("fast", 13_620),
    ]
    assert "| fast | sample | 640x480 | 13620 |" in frame_table(rows)
