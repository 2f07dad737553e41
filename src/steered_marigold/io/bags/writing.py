"""One way to write messages, whatever the storage: same version of ROS, or ROS 1 made ROS 2."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from rosbags.convert.converter import LATCH, STATIC_MSGTYPE_RENAMES, generate_message_converter
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from steered_marigold.errors import InputError
from steered_marigold.io.bags.image_messages import unit_of
from steered_marigold.io.bags.messages import IMAGE, Message, encode, typestore
from steered_marigold.io.bags.reading import Reader
from steered_marigold.io.depth_encodings import MILLIMETRE

# `ros2 bag` reads it from Humble on; the next one only from Iron on
_METADATA_VERSION: Literal[8] = 8
_UNKNOWN = "# the recording held no definition of this type\n"
_UNKNOWN_HASH = "RIHS01_" + 64 * "0"


def storage_of(reader: Reader) -> str:
    """How the recording is stored: ros1, sqlite3 or mcap."""
    if isinstance(reader, Reader1):
        return "ros1"
    return "mcap" if any(isinstance(each, McapReader) for each in _storages(reader)) else "sqlite3"


def attachments_of(reader: Reader) -> int:
    """How many attachments the recording's .mcap files hold."""
    mcaps = [each for each in _storages(reader) if isinstance(each, McapReader)]
    return sum(mcap.statistics.attachement_count for mcap in mcaps if mcap.statistics)


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """InputError that names `path` if the system refuses to write."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path.name}: cannot be written ({reason})") from error


class Target:
    """A recording being written at `path`; as a context, whole if the block ends without error.

    unknown_types: those whose definition is not known, of the topics written so far.
    """

    def __init__(self, reader: Reader, path: Path, storage: str) -> None:
        self._reader, self._path = reader, path
        self.unknown_types: set[str] = set()
        self._connections: dict[Any, Any] = {}
        self._writer: Writer1 | Writer2
        if storage == "ros1":
            self._writer = _ros1_writer(reader, path)
        else:
            self._writer = _ros2_writer(reader, path, storage)
        is_converted = isinstance(reader, Reader1) and storage != "ros1"
        self._conversion = _Conversion(reader, path.name) if is_converted else None

    def __enter__(self) -> "Target":
        with write_errors(self._path):
            self._writer.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:  # topics without messages stay in the list of topics
            for connection in self._reader.connections:
                self._written_as(connection)
        with write_errors(self._path):
            self._writer.__exit__(kind, error, trace)

    def copy(self, connection: Connection, time: int, data: bytes) -> None:
        """Writes a message of the recording."""
        converted = self._as_written(connection, data)
        with write_errors(self._path):
            self._writer.write(self._written_as(connection), time, converted)

    def add(self, topic: str, kind: str, time: int, data: bytes, like: str) -> None:
        """Writes a message of another topic, with the properties of the topic `like`."""
        pattern = next(each for each in self._reader.connections if each.topic == like)
        definition = _known_definition(kind, isinstance(self._reader, Reader1))
        ext = pattern.ext
        if isinstance(ext, ConnectionExtRosbag1):
            ext = ext._replace(callerid=None)  # another program wrote that topic
        connection = pattern._replace(
            topic=topic, msgtype=kind, msgdef=definition[0], digest=definition[1], ext=ext
        )
        self.copy(connection, time, data)

    def _written_as(self, connection: Connection) -> Connection:
        """The connection of the output; those that it cannot tell apart become one."""
        if isinstance(self._writer, Writer1):
            key: Any = connection[1:5], connection.ext
        elif isinstance(connection.ext, ConnectionExtRosbag1):  # ROS 2 does not name publishers
            key = connection.topic, connection.msgtype, connection.ext.latching
        else:
            key = connection.topic, connection.msgtype, repr(connection.ext)
        if key not in self._connections:
            self._connections[key] = self._new_connection(connection)
        written: Connection = self._connections[key]
        return written

    def _new_connection(self, connection: Connection) -> Connection:
        writer, ext = self._writer, connection.ext
        if isinstance(writer, Writer1):
            return writer.add_connection(
                connection.topic,
                connection.msgtype,
                msgdef=connection.msgdef.data,
                md5sum=connection.digest,
                callerid=ext.callerid,  # type: ignore[union-attr]
                latching=ext.latching,  # type: ignore[union-attr]
            )
        kind = STATIC_MSGTYPE_RENAMES.get(connection.msgtype, connection.msgtype)
        if self._conversion:
            return writer.add_connection(
                connection.topic,
                kind,
                typestore=self._conversion.target_types(connection.msgtype),
                offered_qos_profiles=LATCH if ext.latching else [],  # type: ignore[union-attr]
            )
        definition, digest = self._definition(connection)
        return writer.add_connection(
            connection.topic,
            kind,
            msgdef=definition,
            rihs01=digest,
            serialization_format=ext.serialization_format,  # type: ignore[union-attr]
            offered_qos_profiles=ext.offered_qos_profiles,  # type: ignore[union-attr]
        )

    def _as_written(self, connection: Connection, data: bytes) -> bytes | memoryview:
        if self._conversion is None:
            return data
        return self._conversion.convert(connection, data)

    def _definition(self, connection: Connection) -> tuple[str, str]:
        """Text and hash of a ROS 2 type: the recording's, else those that rosbags knows."""
        text, kind = connection.msgdef.data, connection.msgtype
        if connection.msgdef.format == MessageDefinitionFormat.NONE or not text.strip():
            if kind not in typestore(2).fielddefs:
                self.unknown_types.add(kind)
                return _UNKNOWN, connection.digest or _hash_of(_UNKNOWN, kind)
            text = _known_definition(kind, False)[0].data
        return text, connection.digest or _hash_of(text, kind)


class _Conversion:
    """ROS 1 messages as ROS 2 messages; InputError where that is impossible.

    where: names the output in errors.
    """

    def __init__(self, reader: Reader, where: str) -> None:
        self._where = where
        self._source = get_typestore(Stores.EMPTY)
        for connection in reader.connections:
            with self._errors(connection.msgtype):
                types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
                known = self._source.fielddefs
                new = {name: fields for name, fields in types.items() if name not in known}
                self._source.register(new)
        self._target = get_typestore(Stores.ROS2_HUMBLE)
        self._converters: dict[str, Any] = {}
        self._defaults: dict[str, object] = {}

    def target_types(self, kind: str) -> Any:
        """The ROS 2 types, with the one that a ROS 1 type becomes."""
        name = STATIC_MSGTYPE_RENAMES.get(kind, kind)
        if name not in self._target.fielddefs:
            with self._errors(kind):
                text = self._source.generate_msgdef(kind, ros_version=2)[0]
                known = self._target.fielddefs
                types = get_types_from_msg(text, name)
                self._target.register({new: t for new, t in types.items() if new not in known})
        return self._target

    def convert(self, connection: Connection, data: bytes) -> bytes | memoryview:
        """The message in ROS 2."""
        kind = connection.msgtype
        with self._errors(f"{kind} of {connection.topic}"):
            if kind == IMAGE:
                data = _without_unit(connection.topic, data, self._where)
            if kind not in self._converters:
                with redirect_stdout(StringIO()):  # rosbags prints what it does
                    self._converters[kind] = generate_message_converter(
                        self._source,
                        self.target_types(kind),
                        kind,
                        STATIC_MSGTYPE_RENAMES.get(kind, kind),
                        self._defaults,
                        src_is2=False,
                        dst_is2=True,
                    )
            converted: bytes | memoryview = self._converters[kind](data)
        return converted

    @contextmanager
    def _errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # rosbags raises many kinds
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{self._where}: {what} cannot be converted to ROS 2 ({reason}); keep the "
                "recording's own format"
            ) from error


def _without_unit(topic: str, data: bytes, where: str) -> bytes:
    """An image without the unit that librealsense appends, which ROS 2 has no place for."""
    raw = Message(topic=topic, type=IMAGE, log_time_ns=0, data=data, ros=1, where=where)
    message = raw.decode()
    if not hasattr(message, "depth_units"):
        return data
    unit = unit_of(message)
    if abs(unit - MILLIMETRE) > 1e-6:
        raise InputError(
            f"{where}: depth of {topic} has units of {unit:g} m, which a ROS 2 image cannot tell; "
            "keep the recording's own format"
        )
    del message.depth_units
    return encode(message, ros=1)


def _ros1_writer(reader: Reader, path: Path) -> Writer1:
    writer = Writer1(path)
    names = {function: name for name, function in decompressors.items()}
    for chunk in reader.chunks.values():  # type: ignore[union-attr]
        name = names[chunk.decompressor]
        if name != "none":
            writer.set_compression(Writer1.CompressionFormat[name.upper()])
        break
    return writer


def _ros2_writer(reader: Reader, path: Path, storage: str) -> Writer2:
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=_METADATA_VERSION, storage_plugin=plugin)
    if isinstance(reader, Reader1):
        return writer
    if reader.compression_mode:
        mode = CompressionMode[reader.compression_mode.upper()]
        writer.set_compression(mode, CompressionFormat.ZSTD)
    elif storage == "mcap" and any(
        chunk.compression for each in _storages(reader) for chunk in getattr(each, "chunks", [])
    ):
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    for key, value in (reader.storage.metadata.custom or {}).items():
        writer.set_custom_data(key, str(value))
    return writer


def _storages(reader: Any) -> list[Any]:
    """The readers of the files of a ROS 2 recording, or none."""
    storage = getattr(reader, "storage", None)
    return list(getattr(storage, "storages", [storage]))


def _known_definition(kind: str, is_ros1: bool) -> tuple[Any, str]:
    """The definition and hash of a type that rosbags ships."""
    store = typestore(1 if is_ros1 else 2)
    text, md5 = store.generate_msgdef(kind, ros_version=1 if is_ros1 else 2)
    definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    return definition, md5 if is_ros1 else store.hash_rihs01(kind)


def _hash_of(text: str, kind: str) -> str:
    """The hash of a definition; of zeros if rosbags cannot read it."""
    separator = "=" * 80 + "\n"
    store = get_typestore(Stores.EMPTY)
    try:
        if text.startswith(f"{separator}IDL: "):
            for part in text.split(separator)[1:]:
                store.register(get_types_from_idl(part.partition("\n")[2]))
        else:
            store.register(get_types_from_msg(text, kind))
        return str(store.hash_rihs01(kind))
    except Exception:  # rosbags raises many kinds; the messages are copied all the same
        return _UNKNOWN_HASH
