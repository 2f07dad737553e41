"""What a killed run left in its folders, and how to know that no other run is at work there."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from steered_marigold.io.files import remove_stale
from steered_marigold.io.locks import run_lock


@contextmanager
def at_work(lock: Path, folders: Iterable[Path]) -> Iterator[bool]:
    """Marks that a run is going on, and removes temporary files of killed ones from its folders.

    Gives whether it is the only one; if not, those of the last hour may be somebody's, and stay.

    lock: a file, created where needed; its content does not matter. Raises InputError if it cannot
    be written.
    """
    with run_lock(lock) as alone:
        for folder in folders:
            remove_stale(folder, **({"older_than_s": 0.0} if alone else {}))
        yield alone
