"""Time, memory, machine, tables and files of the benchmarks. Needs Linux (/proc), not torch."""

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
    """seconds: of each timed run. peak_mib: the most memory that one took above what was resident
    before it [MiB]."""

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
    """Runs without warm-up."""
    seconds, peaks = [], []
    for _ in range(repeats):
        before = resident_mib()
        reset_peak()
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
        peaks.append(peak_mib() - before)
    return Timing(tuple(seconds), max(peaks))


def measure_interleaved(
    works: Mapping[Key, Callable[[], object]], *, warm_up: int, repeats: int
) -> dict[Key, Timing]:
    """Every work once, then every work again: what disturbs the machine disturbs all alike."""
    for _ in range(warm_up):
        for work in works.values():
            work()
    rounds = [
        {name: measure(work, repeats=1) for name, work in works.items()} for _ in range(repeats)
    ]
    return {
        name: Timing(
            tuple(one[name].seconds[0] for one in rounds), max(one[name].peak_mib for one in rounds)
        )
        for name in works
    }


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
