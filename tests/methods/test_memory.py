"""What does not fit is refused by name, before the work."""

import sys
from pathlib import Path

import pytest
import torch

from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError
from steered_marigold.methods.memory import available_memory, require_memory
from steered_marigold.methods.steered import SteeredCompleter
from tests.diffusion.conftest import tiny_pipeline

GB = 10**9


def test_64_megapixels_need_more_than_4_gb() -> None:
    size = (8000, 8000)
    with pytest.raises(InputError, match=r"`image` has 64 megapixels.* 9\.1 GB.* 4\.0 GB are free"):
        require_memory(size, 1, available=4 * GB)
    require_memory(size, 1, available=10 * GB)
    with pytest.raises(InputError, match="megapixels"):
        require_memory(size, 2, available=10 * GB)  # an ensemble takes more
    require_memory(size, 1, available=None)


@pytest.mark.skipif(available_memory() is None, reason="the system does not tell")
def test_a_frame_that_is_too_large_is_refused_before_the_work() -> None:
    nothing = torch.zeros(1, 1).expand(100_000, 100_000)
    frame = Frame(
        image=torch.zeros(1, 1, 3, dtype=torch.uint8).expand(100_000, 100_000, 3),
        sparse_depth=nothing,
        valid_mask=torch.zeros(1, 1, dtype=torch.bool).expand(100_000, 100_000),
    )
    completer = SteeredCompleter(tiny_pipeline(), "tiny", preset="fast")
    with pytest.raises(InputError, match=r"`image` has 10000 megapixels.* 1400\.1 GB"):
        completer.run(frame, torch.Generator())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_what_this_machine_has() -> None:
    available = available_memory()
    assert available is not None
    assert 2**26 < available < 2**50


def test_a_container_counts(tmp_path: Path) -> None:
    assert available_memory(tmp_path) is None
    group = tmp_path / "sys/fs/cgroup"
    group.mkdir(parents=True)
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/meminfo").write_text(
        "MemAvailable: 4000 kB\nSwapFree:     1000 kB\nHuge: 0\n"
    )
    assert available_memory(tmp_path) == 5000 * 1024
    for name, text in (("current", "3000000"), ("stat", "anon 5\ninactive_file 500000\n")):
        (group / f"memory.{name}").write_text(text)
    for limit, expected in (("max", 5000 * 1024), ("4000000", 1500000), ("90000000", 5000 * 1024)):
        (group / "memory.max").write_text(limit)
        assert available_memory(tmp_path) == expected
