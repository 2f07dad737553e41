"""Time, memory, the idle machine, tables and files of the benchmarks.

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
from typing import Annotated, Any, TypeVar

import typer

from steered_marigold.io.files import atomic_write

Key = TypeVar("Key", bound=Hashable)
Force = Annotated[
    bool,
    typer.Option(
        envvar="BENCHMARK_FORCE", help="Measure on a busy machine too; the record says so."
    ),
]
# processes that run or wait for a core, on average over the last minute
IDLE_LOAD = 0.3
# after a benchmark of two threads the load takes two minutes to fall
PATIENCE_S = 300.0
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

    def times_faster(self, than: "Timing | None") -> float | None:
        """The ratio of the medians; None without a timing to compare with."""
        return None if than is None else than.median / self.median


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


def idle_machine(threads: int, *, force: bool, patience_s: float = PATIENCE_S) -> dict[str, Any]:
    """What figures depend on besides the code, on a machine that does nothing else.

    Waits until the load is at most IDLE_LOAD. Exits with a message if it is not after so many
    seconds; force: begins at once whatever it is, and says so in the record.
    """
    begin = time.monotonic()
    while (load := os.getloadavg()[0]) > IDLE_LOAD and not force:
        if time.monotonic() - begin >= patience_s:
            raise SystemExit(
                f"the load is {load:.2f}, and times count on an idle machine alone (at most "
                f"{IDLE_LOAD}): stop what else runs, or give --force, which the record will say"
            )
        time.sleep(5)
    return {**machine(), "threads": threads, "load_at_start": load, "forced": force}


def machine() -> dict[str, Any]:
    """The date, the hardware and the versions."""
    cpus = Path("/proc/cpuinfo").read_text().splitlines()
    names = {line.partition(":")[2].strip() for line in cpus if line.startswith("model name")}
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    packages = (
        "steered-marigold",
        "torch",
        "diffusers",
        "scipy",
        "numpy",
        "opencv-python-headless",
    )
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "processor": ", ".join(sorted(names)) or platform.machine(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory / 2**30, 1),
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def describe(record: Mapping[str, Any]) -> str:
    """The machine of a record in one line, for the head of a table."""
    forced = ", busy machine (--force)" if record["forced"] else ""
    return (
        f"{record['processor']}, {record['threads']} threads of {record['cores']} cores, "
        f"{record['memory_gib']} GiB, torch {record['torch']}, {record['date'][:10]}, "
        f"load {record['load_at_start']:.2f} at the start{forced}"
    )


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Writes atomically; dataclasses become objects."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=1, default=_plain)
    with atomic_write(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    print(f"\n{path}\n")


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else asdict(value)


def ratio_cell(timing: Timing, than: Timing | None) -> str:
    """How many times faster than another, for a table."""
    ratio = timing.times_faster(than)
    return "" if ratio is None else f"{ratio:.3g}"


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
