"""The records of a run on object storage, which can replace objects and not add to them."""

import json
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.io.remote import RemotePath

PERIOD_S = 60.0


@contextmanager
def remote_records(run: RemotePath, *, anew: bool) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Gives what adds a line to the records below `run`.

    Every PERIOD_S seconds, and at the end of the block, the lines since then become an object,
    records-SESSION-NUMBER.jsonl. anew: those of earlier sessions are removed.

    Raises InputError if the storage refuses; SteeredMarigoldError at the end of the block.
    """
    if anew:
        for path in run.iterdir():
            if path.name.startswith("records-"):
                path.unlink(missing_ok=True)
    session = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{uuid.uuid4().hex[:8]}"
    lines: list[str] = []
    number, put = 0, time.monotonic()

    def flush() -> None:
        nonlocal number, put
        if lines:
            (run / f"records-{session}-{number:05d}.jsonl").write_bytes("".join(lines).encode())
            lines.clear()
            number += 1
        put = time.monotonic()

    def append(values: Mapping[str, Any]) -> None:
        lines.append(json.dumps(values) + "\n")
        if time.monotonic() - put >= PERIOD_S:
            flush()

    try:
        yield append
    finally:
        try:
            flush()
        except InputError as error:
            raise SteeredMarigoldError(
                f"{error}; the records of {len(lines)} frames are lost, their results are not"
            ) from error
