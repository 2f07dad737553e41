"""Locks that the system lets go of when a process ends, however it ends."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from steered_marigold.errors import InputError
from steered_marigold.io.remote import RemotePath

if sys.platform != "win32":
    import fcntl

_WAIT_S = 2.0  # the processes of a run that was killed end a moment later


@contextmanager
def run_lock(path: Path, *, wait_s: float = _WAIT_S) -> Iterator[bool]:
    """Marks by a file that a run is going on; gives whether no other one is.

    If none is, temporary files beside it are nobody's. wait_s: for others to end. False on file
    systems and object storage without locks. Raises InputError if the file cannot be written.
    """
    if sys.platform == "win32" or isinstance(path, RemotePath):
        yield False
        return
    try:
        file = path.open("a")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    with file:
        until = time.monotonic() + wait_s
        while not (alone := _flock(file, fcntl.LOCK_EX)) and time.monotonic() < until:
            time.sleep(0.1)
        _flock(file, fcntl.LOCK_SH)
        yield alone


def _flock(file: IO[str], operation: int) -> bool:
    """Whether the lock is ours; never on file systems without locks."""
    try:
        fcntl.flock(file, operation | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
