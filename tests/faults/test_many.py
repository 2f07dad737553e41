"""A folder of many files, and what it costs to look at it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.many import ROOT

# planning is linear in time and memory; docs/scale.md tells what a million costs
FRAMES = 200_000 if "FAULTS" in os.environ else 20_000


@pytest.mark.slow
def test_a_million_frames_would_be_planned_in_a_minute_and_500_mb(tmp_path: Path) -> None:
    """Of fewer, the share. In a process of its own, for its own peak of memory."""
    told = subprocess.run(
        [sys.executable, "-m", "tests.faults.many", str(FRAMES), str(tmp_path)],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    ).stdout.split()
    _, busy_seconds, _, megabytes = map(float, told)
    assert busy_seconds < 60 * FRAMES / 1_000_000
    assert megabytes < 500 * FRAMES / 1_000_000
