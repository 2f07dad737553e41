"""Copies of recordings with messages added, byte for byte and in constant memory."""

import heapq
import re
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.errors import InputError
from steered_marigold.io.bags.image_messages import encode_depth, image_message
from steered_marigold.io.bags.messages import IMAGE, encode, typestore
from steered_marigold.io.bags.reading import Reader, open_reader, raw_messages
from steered_marigold.io.bags.recorded_frame import RecordedFrame
from steered_marigold.io.bags.recording import Recording
from steered_marigold.io.bags.topics import base_topic
from steered_marigold.io.bags.writing import Target, attachments_of, storage_of, write_errors
from steered_marigold.io.files import AnyPath
from steered_marigold.io.locks import run_lock

# in the hidden folder of a run: it is going on
_LOCK = "lock"


@dataclass(frozen=True, kw_only=True)
class ExtraMessage:
    """A message to be added.

    like: the topic of the recording whose quality of service or latching it takes over.
    data: serialised as the recording's version of ROS does.
    """

    topic: str
    type: str
    log_time_ns: int
    data: bytes
    like: str


@dataclass(frozen=True, kw_only=True)
class CompletedMessages:
    """What is added for a frame, and how many depths the encoding could not hold."""

    messages: tuple[ExtraMessage, ...]
    lost: int


@dataclass(frozen=True, kw_only=True)
class CopyRecord:
    """What was written.

    unknown_types: types of topics whose definition neither the recording nor rosbags has; their
    messages are there, with an empty definition. attachments: how many a .mcap file held, which
    are not copied.
    """

    path: Path
    copied: int
    added: int
    unknown_types: tuple[str, ...]
    attachments: int


def completed_topics(depth_topic: str) -> tuple[str, str]:
    """The topics of completed depth and of its uncertainty.

    Compressed depth keeps its transport at the end of the name, where image_transport looks for it.
    """
    base = base_topic(depth_topic)
    return f"{base}/completed{depth_topic.removeprefix(base)}", f"{base}/completed/uncertainty"


def completed_messages(
    frame: RecordedFrame,
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"] | None = None,
) -> CompletedMessages:
    """Depth [m], 0 = unknown, encoded as the frame's depth is, and uncertainty [m] as 32FC1.

    Both have the header of the frame's depth, and the image's frame_id if depth had to be
    registered to it, and are written down when the frame's depth was.
    """
    like = frame.depth.decode()
    if frame.extrinsics is not None:
        frame_id = frame.image.decode().header.frame_id
        like.header = replace(like.header, frame_id=frame_id)
    encoded = encode_depth(depth, like, str(frame.depth), depth_scale=frame.depth_scale)
    made = [encoded.message]
    if uncertainty is not None:
        values = uncertainty.detach().to("cpu", torch.float32).numpy()
        values = np.where(np.isfinite(values), values, np.float32(np.nan))
        made.append(image_message(like, values, kind=typestore(frame.depth.ros).types[IMAGE]))
    messages = tuple(
        ExtraMessage(
            topic=topic,
            type=message.__msgtype__,
            log_time_ns=frame.depth.log_time_ns,
            data=encode(message, ros=frame.depth.ros),
            like=frame.depth.topic,
        )
        for topic, message in zip(completed_topics(frame.depth.topic), made, strict=False)
    )
    return CompletedMessages(messages=messages, lost=encoded.lost)


def copy_with(
    recording: Recording,
    out_path: AnyPath,
    extra_messages: Iterable[ExtraMessage],
    *,
    format: str | None = None,
    overwrite: bool = False,
) -> CopyRecord:
    """Every message of the recording, byte for byte at its log time, and the extra ones among them.

    extra_messages: in the order of their log times; taken one by one as their time comes, so that
    a generator may compute them, from the frames of the same recording for instance.
    format: "mcap", "sqlite3" or None, which keeps the recording's storage, and its compression
    where rosbags can write it; a ROS 1 recording in another format has its messages converted to
    ROS 2. out_path: a .bag for ROS 1, else a folder, or a file if it ends with .mcap, which
    implies "mcap". It appears when all is written; a run that is interrupted leaves nothing there.

    Log times are kept; a .mcap's times of publishing become its log times.

    Raises InputError if out_path exists and is not to be overwritten, or cannot be written or does
    not fit the format, if the recording has a topic of the extra messages already, and for types
    that cannot be converted; FileFormatError if the recording is damaged.
    """
    out_path = Path(out_path)
    with open_reader(recording.path) as reader:
        storage = _storage_for(reader, out_path, format)
        _require_free(out_path, recording.path, overwrite)
        existing = {topic.name for topic in recording.topics}
        with _finished_at(out_path) as temporary, Target(reader, temporary, storage) as target:
            added = 0
            for time, connection, item in _merged(reader, extra_messages):
                if connection is not None:
                    target.copy(connection, time, item)
                    continue
                if item.topic in existing:
                    raise InputError(
                        f"{recording.path}: has a topic {item.topic} already; take the recording "
                        "that was not completed"
                    )
                target.add(item.topic, item.type, time, item.data, item.like)
                added += 1
        return CopyRecord(
            path=out_path,
            copied=sum(topic.count for topic in recording.topics),
            added=added,
            unknown_types=tuple(sorted(target.unknown_types)),
            attachments=attachments_of(reader),
        )


def _merged(reader: Reader, extra: Iterable[ExtraMessage]) -> Iterator[tuple[int, Any | None, Any]]:
    """(log time, connection or None, data or ExtraMessage) of both; originals first at a time."""
    originals = ((time, connection, data) for connection, time, data in raw_messages(reader))
    extras = ((message.log_time_ns, None, message) for message in extra)
    return heapq.merge(originals, extras, key=lambda entry: entry[0])


def _storage_for(reader: Reader, out_path: Path, wanted: str | None) -> str:
    """What to write, checked against the extension of the path."""
    if wanted not in (None, "mcap", "sqlite3"):
        raise InputError(f"`format` is mcap or sqlite3, not {wanted!r}")
    storage = wanted or ("mcap" if out_path.suffix == ".mcap" else storage_of(reader))
    fits = {
        "ros1": out_path.suffix == ".bag",
        "mcap": out_path.suffix not in (".bag", ".db3"),
        "sqlite3": out_path.suffix not in (".bag", ".db3", ".mcap"),
    }
    if not fits[storage]:
        names = {
            "ros1": "a ROS 1 recording needs the extension .bag, or a `format` of ROS 2",
            "mcap": "mcap is written as a folder or a file with the extension .mcap",
            "sqlite3": "sqlite3 is written as a folder; name one without an extension",
        }
        raise InputError(f"{out_path}: {names[storage]}")
    return storage


def _require_free(out_path: Path, in_path: Path, overwrite: bool) -> None:
    if out_path.resolve() == in_path.resolve():
        raise InputError(f"{out_path}: is the recording itself; name another output")
    if out_path.exists() and not overwrite:
        raise InputError(f"{out_path}: exists; remove it, or set `overwrite`")
    if not out_path.absolute().parent.is_dir():
        raise InputError(f"{out_path}: there is no folder {out_path.parent}; create it")


@contextmanager
def _finished_at(out_path: Path) -> Iterator[Path]:
    """A path beside `out_path` to write to; moved there at the block's end, removed if it fails.

    It has the name of `out_path` in a hidden folder, because a bag's files are named after it.
    What a run that was killed left of such folders is removed.
    """
    _remove_left(out_path)
    hidden = out_path.with_name(f".{out_path.name}.{uuid.uuid4().hex[:8]}")
    temporary = hidden / out_path.name
    try:
        with write_errors(out_path):
            hidden.mkdir()
        with run_lock(hidden / _LOCK):
            yield temporary
            if out_path.suffix == ".mcap":  # rosbags wrote a folder with this one file
                temporary = temporary / f"{out_path.name}.mcap"
            with write_errors(out_path):
                if out_path.is_dir():
                    out_path.rename(hidden / "replaced")
                temporary.replace(out_path)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _remove_left(out_path: Path) -> None:
    """Hidden folders of runs towards `out_path` that go on no more."""
    hidden = re.compile(rf"\.{re.escape(out_path.name)}\.[0-9a-f]{{8}}")
    for folder in out_path.absolute().parent.iterdir():
        if hidden.fullmatch(folder.name) and folder.is_dir():
            with run_lock(folder / _LOCK, wait_s=0.0) as alone:
                if alone:
                    shutil.rmtree(folder, ignore_errors=True)
