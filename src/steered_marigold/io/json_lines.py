"""Files of one JSON object a line, each on disk before the next is begun."""

import errno
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from steered_marigold.errors import FileFormatError, InputError


class JsonLines:
    """A log of JSON objects. A line that a kill cut short is dropped when the log is read."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> Iterator[dict[str, Any]]:
        """The objects, in order; none if there is no file.

        Raises FileFormatError, naming the line, if one is no object.
        """
        if not self.path.is_file():
            return
        self.drop_unfinished_line()
        with self.path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                try:
                    values = json.loads(line)
                except ValueError as error:
                    raise FileFormatError(
                        f"{self.path}: is not a log, line {number} is no JSON ({error})"
                    ) from error
                if not isinstance(values, dict):
                    raise FileFormatError(f"{self.path}: is not a log, line {number} is no object")
                yield values

    def append(self, values: Mapping[str, Any]) -> None:
        """Adds an object in one write; returns when it is on disk.

        Raises InputError if the system refuses.
        """
        line = (json.dumps(values) + "\n").encode()
        try:
            # unbuffered: several runs may append to one file
            with self.path.open("ab", buffering=0) as file:
                if file.write(line) < len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror})") from error

    def drop_unfinished_line(self) -> None:
        """Cuts off what follows the last end of a line."""
        with self.path.open("rb+") as file:
            end = file.seek(0, os.SEEK_END)
            while end > 0:
                start = max(0, end - 65536)
                file.seek(start)
                at = file.read(end - start).rfind(b"\n")
                if at >= 0:
                    end = start + at + 1
                    break
                end = start
            if end < file.seek(0, os.SEEK_END):
                file.truncate(end)
