"""Where cameras stand: the transforms of /tf_static and /tf, and those of librealsense."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from steered_marigold.core.geometry import rotation_of
from steered_marigold.io.bags.cameras import frame_name
from steered_marigold.io.bags.messages import TRANSFORM, TRANSFORMS, Message
from steered_marigold.io.bags.reading import Reader, first_message, messages, topics_of
from steered_marigold.io.bags.topics import realsense_stream

# transforms that differ less than this [m, rad] are one that was sent again
STILL = 1e-6


def fixed_transform(reader: Reader, source: str, target: str) -> NDArray[Any] | None:
    """4x4 from points of frame `source` to points of `target`; None if the recording has none.

    Fixed is what /tf_static holds, and what /tf repeats without a change: old programs send fixed
    transforms again and again.
    """
    if source == target and source:
        return np.eye(4)
    transforms = static_transforms(reader)
    matrix = transforms.lookup(source, target)
    if matrix is None:
        for message in moving_transforms(reader):
            transforms.add_message(message.decode())
        matrix = transforms.lookup(source, target)
    return matrix


def static_transforms(reader: Reader) -> "StaticTransforms":
    """What /tf_static holds, and a RealSense camera's own."""
    transforms = StaticTransforms()
    for message in messages(reader, _topics(reader, "tf_static")):
        transforms.add_message(message.decode())
    _add_realsense(reader, transforms)
    return transforms


def moving_transforms(reader: Reader) -> Iterator[Message]:
    """The messages of /tf."""
    return messages(reader, _topics(reader, "tf"))


def _topics(reader: Reader, name: str) -> list[str]:
    """Topics of transforms of this name, in whatever namespace."""
    topics = [topic.name for topic in topics_of(reader) if topic.type in TRANSFORMS]
    return [topic for topic in topics if topic.endswith(name)]


def matrix_of(transform: Any) -> NDArray[Any]:
    """4x4 of a geometry_msgs Transform: points of the child to points of the parent."""
    t, q = transform.translation, transform.rotation
    quaternion = torch.tensor([q.x, q.y, q.z, q.w], dtype=torch.float64)
    matrix = np.eye(4)
    # some drivers write only zeros
    matrix[:3, :3] = rotation_of(quaternion / (quaternion.norm() or 1)).numpy()
    matrix[:3, 3] = t.x, t.y, t.z
    return matrix


class StaticTransforms:
    """A forest of frames; those that move are not in it."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, NDArray[Any]]] = {}
        self._moving: set[str] = set()

    def add(self, parent: str, child: str, matrix: NDArray[Any]) -> None:
        """Notes that `matrix` takes points of `child` to points of `parent`."""
        parent, child = frame_name(parent), frame_name(child)
        known = self._parents.setdefault(child, (parent, matrix))
        if known[0] != parent or np.abs(known[1] - matrix).max() > STILL:
            self._moving.add(child)

    def add_message(self, message: Any) -> None:
        """Notes all transforms of a TFMessage."""
        for stamped in message.transforms:
            matrix = matrix_of(stamped.transform)
            self.add(stamped.header.frame_id, stamped.child_frame_id, matrix)

    def lookup(self, source: str, target: str) -> NDArray[Any] | None:
        """4x4 from points of `source` to points of `target`; None if no fixed chain joins them."""
        return joined(*(ancestors(frame_name(frame), self.above) for frame in (source, target)))

    def above(self, frame: str) -> tuple[str, NDArray[Any]] | None:
        """The parent of a frame that is fixed to it, and the matrix that takes its points there."""
        return None if frame in self._moving else self._parents.get(frame)


def ancestors(
    frame: str, above: Callable[[str], tuple[str, NDArray[Any]] | None]
) -> dict[str, NDArray[Any]]:
    """The frame and all above it, each with the 4x4 that takes the frame's points there.

    above: a frame's parent, and the 4x4 that takes its points there; None for a root.
    """
    matrix = np.eye(4)
    found = {frame: matrix}
    while (step := above(frame)) is not None and step[0] not in found:
        frame, matrix = step[0], step[1] @ matrix
        found[frame] = matrix
    return found


def joined(
    upwards: dict[str, NDArray[Any]], downwards: dict[str, NDArray[Any]]
) -> NDArray[Any] | None:
    """4x4 from points of one frame to those of another, given what is above each; None if nothing
    is above both.
    """
    for frame, to_frame in upwards.items():
        if frame in downwards:
            matrix: NDArray[Any] = np.linalg.inv(downwards[frame]) @ to_frame
            return matrix
    return None


def _add_realsense(reader: Reader, transforms: StaticTransforms) -> None:
    """Each stream's <stream>/tf/<group>: points of the group's reference to those of the stream.

    As librealsense's device::get_extrinsics writes it and playback_device::calc_extrinsic reads it.
    """
    for topic in topics_of(reader):
        stream, _, group = topic.name.partition("/tf/")
        if topic.type == TRANSFORM and group and realsense_stream(f"{stream}/image/data"):
            message = first_message(reader, topic.name)
            if message is not None:
                reference_to_stream = matrix_of(message.decode())
                transforms.add(f"reference {group}", stream, np.linalg.inv(reference_to_stream))
