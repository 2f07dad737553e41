"""Whether a frame fits into the machine's memory: told before the work, not by its end."""

from pathlib import Path

from steered_marigold.errors import InputError

# bytes a pixel of the answer, of its first ensemble member and of each further one, on top of a
# loaded model: peaks of frames of 3 to 24 megapixels, see docs/reliability.md
FIRST_MEMBER, EACH_MEMBER, REST = 140, 45, 100 * 2**20


def require_memory(size: tuple[int, int], members: int, *, available: int | None) -> None:
    """InputError if completing a frame of `size` (height, width) would take more than `available`.

    members: of the ensemble. available: bytes, as `available_memory` gives; None: nobody knows.
    """
    height, width = size
    needed = height * width * (FIRST_MEMBER + EACH_MEMBER * (members - 1)) + REST
    if available is not None and needed > available:
        raise InputError(
            f"`image` has {height * width / 1e6:.0f} megapixels, which take about "
            f"{needed / 1e9:.1f} GB of memory, and {available / 1e9:.1f} GB are free; make it and "
            "its depth smaller"
        )


def available_memory(root: Path = Path("/")) -> int | None:
    """Bytes that processes may still take: free, held for files, and swap; None if unknown.

    A container's limit counts as the machine's. root: where proc and sys are.
    """
    try:
        lines = (root / "proc/meminfo").read_text(encoding="ascii").splitlines()
        fields = {line.split(":")[0]: int(line.split()[1]) * 1024 for line in lines}
        free = fields["MemAvailable"] + fields["SwapFree"]
    except (OSError, ValueError, LookupError):
        return None
    group = root / "sys/fs/cgroup"
    try:
        limit, used = (int((group / f"memory.{x}").read_text("ascii")) for x in ("max", "current"))
        stat = (line.split() for line in (group / "memory.stat").read_text("ascii").splitlines())
        cached = next(int(value) for name, value in stat if name == "inactive_file")
    except (OSError, ValueError, StopIteration):  # "max" is no limit
        return free
    return min(free, limit - used + cached)
