"""The comparison with an earlier commit's solve."""

import json
from pathlib import Path

import pytest

from benchmarks import solve

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs the repository's history")
def test_both_are_timed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    solve.main(since="HEAD", sizes="32x24", output=tmp_path, repeats=1, threads=1)
    timings = json.loads((tmp_path / "solve.json").read_text())["timings"]
    assert len(timings) == 4
    assert all(set(both) == {"before", "now"} for both in timings.values())
    assert "told, 32x24, 95% measured" in capsys.readouterr().out
