"""What the page remembers of each visitor, and for how long."""

import secrets
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock

from jaxtyping import Bool
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.frames.complete import Record

IDLE_S = 3600.0  # a visitor who does nothing for so long is forgotten


@dataclass(kw_only=True)
class Session:
    """One visitor, from opening the page to closing it.

    folder: holds this visitor's files alone. image, depth: the files that are open, or None.
    frame: what was read, whole. erased: where its measurements are hidden from the completion.
    completed: the frame that went in, its answer and record. canvas_of: the frame that holes are
    drawn on. stop: set by whoever wants the run to end.
    """

    folder: Path
    image: Path | None = None
    depth: Path | None = None
    frame: Frame | None = None
    erased: Bool[Tensor, "height width"] | None = None
    completed: tuple[Frame, DepthCompletion, Record] | None = None
    canvas_of: Frame | None = None
    stop: Event = field(default_factory=Event)
    used: float = field(default_factory=time.monotonic)

    def keep(self, uploaded: str | Path, kind: str) -> Path:
        """Moves an upload into the session's folder; those of different kinds may share names."""
        source = Path(uploaded)
        target = self.folder / kind / source.name
        if source != target:
            target.parent.mkdir(exist_ok=True)
            shutil.move(source, target)
        return target

    def show(self, frame: Frame) -> None:
        """From now on, this frame; what was done with the one before ends, and is forgotten."""
        self.stop.set()
        self.frame, self.erased, self.completed, self.canvas_of = frame, None, None, None


class Sessions:
    """The visitors, each by the name that the browser's page has."""

    def __init__(self, folder: Path, *, most: int) -> None:
        """folder: for the visitors' folders. most: so many are remembered at a time."""
        self._folder, self._most = folder, most
        self._sessions: dict[str, Session] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._sessions)

    def of(self, name: str) -> Session:
        """The visitor's session, a new one at the first call."""
        with self._lock:
            self._forget_idle(name)
            if name not in self._sessions:
                folder = self._folder / secrets.token_urlsafe(24)
                folder.mkdir(mode=0o700, parents=True)
                self._sessions[name] = Session(folder=folder)
            session = self._sessions[name]
            session.used = time.monotonic()
            return session

    def close(self, name: str) -> None:
        """Ends what the visitor's run does, and removes the files."""
        with self._lock:
            self._close(name)

    def _forget_idle(self, name: str) -> None:
        """The idle ones, and so many of the least recently used that there is room for another."""
        others = sorted((s.used, key) for key, s in self._sessions.items() if key != name)
        spare = max(0, len(others) - (self._most - 1))
        oldest = time.monotonic() - IDLE_S
        for rank, (used, key) in enumerate(others):
            if rank < spare or used < oldest:
                self._close(key)

    def _close(self, name: str) -> None:
        session = self._sessions.pop(name, None)
        if session is not None:
            session.stop.set()
            shutil.rmtree(session.folder, ignore_errors=True)
