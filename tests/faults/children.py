"""Processes that do something and are ended, without waiting for torch to load once more."""

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path


class Child:
    """A copy of this process that calls a function; its stdout and stderr go to a file."""

    def __init__(self, work: Callable[[], object], out: Path, *, stdout: int | None = None) -> None:
        """stdout: a file descriptor in the place of the file."""
        self.out = out
        self.pid = os.fork()
        if self.pid == 0:
            self._become(work, stdout)

    def _become(self, work: Callable[[], object], stdout: int | None) -> None:
        code = 1
        # as in a terminal; whoever runs the tests in the background has Ctrl-C ignored
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            file = os.open(self.out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, 2)
            os.dup2(file if stdout is None else stdout, 1)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            sys.stdin = open(os.devnull)  # noqa: SIM115, PTH123
            work()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            for stream in (sys.stdout, sys.stderr):
                try:
                    stream.flush()
                except OSError:
                    code = code or 120  # as the interpreter does
            os._exit(code)

    def end(self, number: int, after_s: float) -> int:
        """Sends a signal after a time; the exit code, negative if the signal was the end."""
        time.sleep(after_s)
        os.kill(self.pid, number)
        return self.wait()

    def wait(self) -> int:
        """The exit code, negative if a signal was the end."""
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])

    def said(self) -> str:
        """All of its stderr, and of its stdout."""
        return self.out.read_text(encoding="utf-8", errors="replace")

    def until(self, happened: Callable[[], bool], limit_s: float = 120.0) -> None:
        """Waits for something that it does."""
        deadline = time.monotonic() + limit_s
        while not happened():
            assert time.monotonic() < deadline, self.said()
            time.sleep(0.005)
