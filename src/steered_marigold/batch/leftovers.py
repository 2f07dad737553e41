"""What a killed run left in its folders, and how to know that no other run is at work there."""

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from steered_marigold.errors import InputError
from steered_marigold.io.files import stale_temporaries
from steered_marigold.io.remote import RemotePath

if sys.platform != "win32":
    import fcntl

_LOCK_WAIT_S = 2.0  # the processes of a run that was killed end a moment later


@contextmanager
def at_work(lock: Path, folders: Iterable[Path]) -> Iterator[bool]:
    """Marks that a run is going on, and removes temporary files of killed ones from its folders.

    Gives whether it is the only one; if not, those of the last hour may be somebody's, and stay.

    lock: a file, created where needed; its content does not matter. Raises InputError if it cannot
    be written.
    """
    with _lock(lock) as alone:
        for folder in folders:
            for left in stale_temporaries(folder, **({"older_than_s": 0.0} if alone else {})):
                left.unlink(missing_ok=True)
        yield alone


@contextmanager
def _lock(path: Path) -> Iterator[bool]:
    """Whether no other run has it; then temporary files are nobody's."""
    if sys.platform == "win32" or isinstance(path, RemotePath):
        yield False
        return
    try:
        file = path.open("a")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    with file:
        until = time.monotonic() + _LOCK_WAIT_S
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
