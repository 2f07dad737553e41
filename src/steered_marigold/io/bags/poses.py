"""Where a recording's camera is at a time: the transforms of /tf_static and /tf, interpolated."""

from bisect import bisect
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steered_marigold.errors import FileFormatError
from steered_marigold.io.bags.cameras import frame_name
from steered_marigold.io.bags.messages import NANOSECONDS, Message, stamp_ns
from steered_marigold.io.bags.reading import Reader
from steered_marigold.io.bags.transforms import (
    STILL,
    StaticTransforms,
    ancestors,
    joined,
    matrix_of,
    moving_transforms,
    static_transforms,
)

# [ns] transforms are looked for in what was recorded so long after a frame, and kept so long
LOOKAHEAD = NANOSECONDS // 2
KEPT = 10 * NANOSECONDS
# [ns] before the first transform of a frame and after its last, they are held so long
HELD = NANOSECONDS // 10
# [ns] between two that are interpolated, unless they are equal
LONGEST_GAP = NANOSECONDS


@dataclass
class PoseCounts:
    """found, missing: frames with and without a pose. damaged: messages that were passed over."""

    found: int = 0
    missing: int = 0
    damaged: int = 0


class CameraPoses:
    """The poses of the image's camera in a frame that stands still, at rising times.

    fixed_frame: the one in use; None as long as none was found. If it is not named it is the odom
    above the camera (REP 105: it does not jump), else the root of the camera's tree, in either
    case only from when the camera was seen to move in it: a tree of fixed mounts alone says
    nothing of how they move together.
    """

    def __init__(
        self, reader: Reader, camera_frame: str, *, fixed_frame: str | None = None
    ) -> None:
        """reader: of nobody else. camera_frame: x right, y down, z forward (REP 103)."""
        self.camera_frame, self.fixed_frame = camera_frame, fixed_frame
        self.counts = PoseCounts()
        self._named = fixed_frame is not None
        self._window = TransformWindow(static_transforms(reader))
        self._messages = moving_transforms(reader)
        self._next = next(self._messages, None)

    def at(self, stamp: int, log_time_ns: int) -> NDArray[np.float64] | None:
        """4x4, camera to fixed frame [m], at a stamp [ns]; None if the transforms do not tell.

        log_time_ns: when the camera's message was written down.
        """
        while self._next is not None and self._next.log_time_ns <= log_time_ns + LOOKAHEAD:
            if self._next.log_time_ns >= log_time_ns - KEPT:
                self._add(self._next)
            self._next = next(self._messages, None)
        pose = self._find(stamp)
        self.counts.found += pose is not None
        self.counts.missing += pose is None
        return pose

    def _add(self, message: Message) -> None:
        try:
            transforms = message.decode().transforms
        except FileFormatError:
            self.counts.damaged += 1
            return
        for stamped in transforms:
            self._window.add(stamped)

    def _find(self, stamp: int) -> NDArray[np.float64] | None:
        camera = self._window.ancestors(self.camera_frame, stamp)
        if not self._named:
            found = self._fixed_above(list(camera))
            if found != self.fixed_frame:
                before, self.fixed_frame = self.fixed_frame, found or self.fixed_frame
                if before is not None:  # poses in two worlds make no motion
                    return None
        if self.fixed_frame is None:
            return None
        return joined(camera, self._window.ancestors(self.fixed_frame, stamp))

    def _fixed_above(self, chain: list[str]) -> str | None:
        """Of the camera's frame and those above it, the one that is taken to stand still."""
        odoms = [frame for frame in chain[1:] if frame.rpartition("/")[2] == "odom"]
        fixed = odoms[0] if odoms else chain[-1]
        moved = not self._window.moving.isdisjoint(chain[: chain.index(fixed)])
        return fixed if moved and (odoms or self._window.is_root(fixed)) else None


class _Stamped(NamedTuple):
    """At a stamp [ns], points of the child to points of the parent."""

    stamp: int
    parent: str
    matrix: NDArray[np.float64]


class TransformWindow:
    """A forest of frames around a time: transforms that are fixed, and the last seconds of others.

    moving: the frames that were seen to move in their parents.
    """

    def __init__(self, fixed: StaticTransforms) -> None:
        self.moving: set[str] = set()
        self._fixed = fixed
        self._recent: dict[str, deque[_Stamped]] = {}

    def add(self, stamped: Any) -> None:
        """Notes a geometry_msgs TransformStamped of /tf."""
        child, parent = frame_name(stamped.child_frame_id), frame_name(stamped.header.frame_id)
        known = self._recent.setdefault(child, deque())
        new = _Stamped(stamp_ns(stamped.header), parent, matrix_of(stamped.transform))
        if known and _differ(known[-1], new):
            self.moving.add(child)
        known.insert(bisect(known, new.stamp, key=lambda each: each.stamp), new)
        while known[0].stamp < known[-1].stamp - KEPT:
            known.popleft()

    def is_root(self, frame: str) -> bool:
        """Whether nothing was ever above a frame."""
        return frame not in self._recent and self._fixed.above(frame) is None

    def ancestors(self, frame: str, stamp: int) -> dict[str, NDArray[np.float64]]:
        """The frame and all above it, each with the 4x4 that takes its points there at a stamp."""
        return ancestors(frame_name(frame), lambda name: self._above(name, stamp))

    def _above(self, frame: str, stamp: int) -> tuple[str, NDArray[np.float64]] | None:
        """The parent at a stamp, and the transform there: interpolated, or the nearest one."""
        known = self._recent.get(frame)
        if not known:
            return self._fixed.above(frame)
        place = bisect(known, stamp, key=lambda each: each.stamp)
        if place in (0, len(known)):
            nearest = known[min(place, len(known) - 1)]
            near = abs(nearest.stamp - stamp) <= HELD
            return (nearest.parent, nearest.matrix) if near else None
        before, after = known[place - 1], known[place]
        gap = after.stamp - before.stamp
        if before.parent != after.parent or (gap > LONGEST_GAP and _differ(before, after)):
            return None
        share = (stamp - before.stamp) / gap
        return before.parent, interpolated(before.matrix, after.matrix, share)


def interpolated(
    first: NDArray[np.float64], second: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    """The 4x4 a share of the way: on a line, turning evenly about one axis (slerp)."""
    between: NDArray[np.float64] = (1 - share) * first + share * second
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    between[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    return between


def _differ(one: _Stamped, other: _Stamped) -> bool:
    return bool(np.abs(one.matrix - other.matrix).max() > STILL)
