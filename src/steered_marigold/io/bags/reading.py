"""Opening recordings: one way in, whatever the storage, and errors in one line."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from steered_marigold.errors import FileFormatError
from steered_marigold.io.bags.messages import Message, RosVersion
from steered_marigold.io.files import AnyPath, require_suffix

Reader = Reader1 | Reader2
BAG_SUFFIXES = (".bag", ".mcap", ".db3")
_REPAIR = (
    "if the recording was cut off, `rosbag reindex`, `ros2 bag reindex` or `mcap recover` may help"
)


@dataclass(frozen=True, kw_only=True)
class Topic:
    """What a recording holds under a name; `type` is as ROS 2 spells it."""

    name: str
    type: str
    count: int

    def __str__(self) -> str:
        return f"{self.name} ({self.type}, {self.count} messages)"


@contextmanager
def open_reader(path: AnyPath) -> Iterator[Reader]:
    """The opened reader of a .bag, .mcap or .db3 file or the folder of a ROS 2 bag.

    Raises FileFormatError if it is missing, damaged or no recording.
    """
    path = Path(path)
    with _rosbags_errors(path):
        reader = _reader_of(path)
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


def ros_version(reader: Reader) -> RosVersion:
    """The version of ROS whose messages the reader gives."""
    return 1 if isinstance(reader, Reader1) else 2


def topics_of(reader: Reader) -> tuple[Topic, ...]:
    """What the recording holds, in the order of the names."""
    counts: dict[tuple[str, str], int] = {}
    for connection in reader.connections:
        key = connection.topic, connection.msgtype
        counts[key] = counts.get(key, 0) + connection.msgcount
    return tuple(
        Topic(name=name, type=kind, count=count) for (name, kind), count in sorted(counts.items())
    )


def list_topics(path: AnyPath) -> tuple[Topic, ...]:
    """What the recording at `path` holds; raises as `open_reader` does."""
    with open_reader(path) as reader:
        return topics_of(reader)


def raw_messages(reader: Reader) -> Iterator[tuple[Any, int, bytes]]:
    """(connection, log time [ns], data) of everything, in the order of the times."""
    return _guarded(reader, reader.connections)


def messages(reader: Reader, topics: Collection[str]) -> Iterator[Message]:
    """The messages of some topics in the order of their log times; FileFormatError if damaged."""
    connections = [connection for connection in reader.connections if connection.topic in topics]
    if not connections:  # rosbags would give the messages of all topics
        return
    for connection, log_time_ns, data in _guarded(reader, connections):
        yield Message(
            topic=connection.topic,
            type=connection.msgtype,
            log_time_ns=log_time_ns,
            data=data,
            ros=ros_version(reader),
            where=str(reader.path),
        )


def first_message(reader: Reader, topic: str) -> Message | None:
    """The earliest message of a topic."""
    return next(messages(reader, [topic]), None)


def _guarded(reader: Reader, connections: Collection[Any]) -> Iterator[tuple[Any, int, bytes]]:
    iterator = reader.messages(connections)
    missing = sum(connection.msgcount for connection in connections)
    while True:
        with _rosbags_errors(Path(str(reader.path))):
            item = next(iterator, None)
            if item is None and missing > 0:  # rosbags passes over records it does not know
                raise ValueError(f"{missing} messages of its index are not there")
        if item is None:
            return
        missing -= 1
        yield item


def _reader_of(path: Path) -> Reader:
    if not path.exists():
        raise FileFormatError(f"{path}: no such file or folder")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise FileFormatError(
                f"{path}: a folder without metadata.yaml is no ROS 2 bag; name the file in it, or "
                "write one with `ros2 bag reindex`"
            )
        return Reader2(path)
    return Reader1(path) if require_suffix(path, BAG_SUFFIXES) == ".bag" else Reader2(path)


@contextmanager
def _rosbags_errors(path: Path) -> Iterator[None]:
    """Turns whatever rosbags raises for damaged bytes into one line that names the file."""
    try:
        yield
    except FileFormatError:
        raise
    except Exception as error:  # from ReaderError to AssertionError, struct.error and TypeError
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FileFormatError(
            f"{path}: damaged, or no recording that can be read ({reason}); {_REPAIR}"
        ) from error
