"""Time, memory, machine, tables and files of the benchmarks.

Needs Linux with glibc (/proc, malloc_trim); loads no torch.
"""

import ctypes
import gc
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from steered_marigold.io.files import atomic_write

Key = TypeVar("Key", bound=Hashable)
_STATUS = Path("/proc/self/status")
_MIB = 1024


@dataclass(frozen=True)
class Timing:
    """seconds: of each timed run. peak_mib: the most memory above what was there before [MiB]."""

    seconds: tuple[float, ...]
    peak_mib: float

    @property
    def median(self) -> float:
        """[s]"""
        return statistics.median(self.seconds)

    @property
    def cells(self) -> tuple[str, str, str]:
        """Median and spread [s] and memory [MiB], for a table."""
        spread = f"{min(self.seconds):.3g} to {max(self.seconds):.3g}"
        return f"{self.median:.3g}", spread, f"{self.peak_mib:.0f}"


def measure(work: Callable[[], object], *, repeats: int) -> Timing:
    """Runs without warm-up; memory is that of the first."""
    first, peak = _first_run(work)
    return Timing((first, *(_seconds(work) for _ in range(repeats - 1))), peak)


def measure_interleaved(
    works: Mapping[Key, Callable[[], object]], *, warm_up: int, repeats: int
) -> dict[Key, Timing]:
    """Every work once, then every work again: what disturbs the machine disturbs all alike.

    warm_up: rounds that are not timed, at least one; memory is that of the first.
    """
    peaks = {name: _first_run(work)[1] for name, work in works.items()}
    for _ in range(warm_up - 1):
        for work in works.values():
            work()
    rounds = [{name: _seconds(work) for name, work in works.items()} for _ in range(repeats)]
    return {name: Timing(tuple(one[name] for one in rounds), peaks[name]) for name in works}


def _first_run(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds and peak memory [MiB], from a heap that holds nothing free for reuse."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    before = resident_mib()
    reset_peak()
    return _seconds(work), peak_mib() - before


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def reset_peak() -> None:
    """Forgets the largest resident set of this process."""
    Path("/proc/self/clear_refs").write_text("5")


def peak_mib() -> float:
    """The largest resident set since the start, or since `reset_peak` [MiB]."""
    return _status("VmHWM") / _MIB


def resident_mib() -> float:
    """[MiB]"""
    return _status("VmRSS") / _MIB


def _status(key: str) -> int:
    lines = _STATUS.read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))


def machine(threads: int) -> dict[str, Any]:
    """What figures depend on besides the code."""
    cpus = Path("/proc/cpuinfo").read_text().splitlines()
    names = {line.partition(":")[2].strip() for line in cpus if line.startswith("model name")}
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    packages = ("steered-marigold", "torch", "diffusers", "scipy", "numpy")
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": ", ".join(sorted(names)) or platform.machine(),
        "cores": os.cpu_count(),
        "threads": threads,
        "memory_gib": round(memory / 2**30, 1),
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Writes atomically; dataclasses become objects."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=1, default=_plain)
    with atomic_write(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    print(f"\n{path}\n")


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else asdict(value)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
