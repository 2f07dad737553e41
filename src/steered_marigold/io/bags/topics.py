"""Which topics hold the image, the depth and the cameras."""

import re
from collections.abc import Callable, Iterable, Sequence

from steered_marigold.errors import InputError
from steered_marigold.io.bags.image_messages import DEPTH_ENCODINGS
from steered_marigold.io.bags.messages import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, Message
from steered_marigold.io.bags.reading import Topic

_TRANSPORTS = ("/compressedDepth", "/compressed")
# parts of names that say a picture is neither colour nor the sensor's depth
_OTHER = re.compile(r"infra|(^|[/_])ir([/_0-9]|$)|confidence|uncertainty|completed|disparity", re.I)
# what drivers call depth that was moved into the colour image
_REGISTERED = re.compile(r"aligned|registered|depth_to_(color|rgb)", re.I)
_GREY = ("mono8", "mono16", "8UC1")
_REALSENSE = re.compile(r"(/device_\d+/sensor_\d+/[^/]+)/image/data")


def realsense_stream(topic: str) -> str | None:
    """The stream, such as /device_0/sensor_0/Depth_0, of an image topic that librealsense wrote."""
    match = _REALSENSE.fullmatch(topic)
    return match[1] if match else None


def base_topic(topic: str) -> str:
    """A topic without what image_transport appended to it."""
    for transport in _TRANSPORTS:
        topic = topic.removesuffix(transport)
    return topic


def is_registered_name(topic: str) -> bool:
    """Whether the driver's name says that depth lies in the colour image."""
    return _REGISTERED.search(topic) is not None


def camera_info_of(topic: str, topics: Iterable[Topic]) -> str | None:
    """The camera_info that belongs to an image topic: its neighbour, by the habit of ROS."""
    stream = realsense_stream(topic)
    space = f"{stream}/info" if stream else base_topic(topic).rpartition("/")[0]
    name = f"{space}/camera_info"
    return name if any(each.name == name and each.type == CAMERA_INFO for each in topics) else None


def find_depth(
    topics: Sequence[Topic], first: Callable[[str], Message | None], depth_topic: str | None
) -> str:
    """`depth_topic`, or the only candidate; registered depth wins over depth that is not.

    first: the first message of a topic. Raises InputError that lists the candidates.
    """
    if depth_topic is not None:
        return _named("depth_topic", depth_topic, topics, (IMAGE, COMPRESSED_IMAGE))
    candidates = [topic for topic in _pictures(topics) if _is_depth(topic, first)]
    registered = [topic for topic in candidates if is_registered_name(topic.name)]
    return _only("depth", "depth_topic", registered or candidates, _pictures(topics))


def find_image(
    topics: Sequence[Topic], first: Callable[[str], Message | None], image_topic: str | None
) -> str:
    """`image_topic`, or the only candidate; colour wins over grey. Arguments as `find_depth`'s."""
    if image_topic is not None:
        return _named("image_topic", image_topic, topics, (IMAGE, COMPRESSED_IMAGE))
    pictures = [topic for topic in _pictures(topics) if not _is_depth(topic, first)]
    candidates = [topic for topic in pictures if _OTHER.search(topic.name) is None]
    coloured = [topic for topic in candidates if not _is_grey(topic, first)]
    return _only("an image", "image_topic", coloured or candidates or pictures, pictures)


def find_info(
    topics: Sequence[Topic], image_topic: str, depth_topic: str, info_topic: str | None
) -> str | None:
    """`info_topic`, or the image's neighbour, or the only camera_info; None if there is none.

    Raises InputError that lists the candidates.
    """
    if info_topic is not None:
        return _named("info_topic", info_topic, topics, (CAMERA_INFO,))
    neighbour = camera_info_of(image_topic, topics)
    if neighbour is None and is_registered_name(depth_topic):
        neighbour = camera_info_of(depth_topic, topics)
    candidates = [topic for topic in topics if topic.type == CAMERA_INFO and topic.count]
    if neighbour or not candidates:
        return neighbour
    return _only("the image's camera_info", "info_topic", candidates, candidates)


def _pictures(topics: Sequence[Topic]) -> list[Topic]:
    """Topics with pictures, each once: as it is if it was recorded so, else compressed."""
    found: dict[str, Topic] = {}
    for topic in topics:
        if topic.type in (IMAGE, COMPRESSED_IMAGE) and topic.count:
            known = found.setdefault(base_topic(topic.name), topic)
            if known.type != IMAGE and (
                topic.type == IMAGE or topic.name.endswith("/compressedDepth")
            ):
                found[base_topic(topic.name)] = topic
    return list(found.values())


def _is_depth(topic: Topic, first: Callable[[str], Message | None]) -> bool:
    message = first(topic.name)
    if message is None or _OTHER.search(topic.name):
        return False
    picture = message.decode()
    if topic.type == COMPRESSED_IMAGE:
        return "compressedDepth" in picture.format or picture.format.startswith("16UC1")
    if picture.encoding == "mono16":  # infrared, too
        return "depth" in topic.name.lower()
    return picture.encoding in DEPTH_ENCODINGS


def _is_grey(topic: Topic, first: Callable[[str], Message | None]) -> bool:
    message = first(topic.name)
    if message is None:
        return False
    picture = message.decode()
    if topic.type == COMPRESSED_IMAGE:
        return picture.format.partition(";")[0].strip() in _GREY
    return picture.encoding in _GREY


def _named(argument: str, name: str, topics: Sequence[Topic], kinds: Sequence[str]) -> str:
    fitting = [topic for topic in topics if topic.type in kinds and topic.count]
    if name not in [topic.name for topic in fitting]:
        raise InputError(
            f"`{argument}`: the recording has no {name} of type {' or '.join(kinds)} with "
            f"messages; it has {_listed(fitting)}"
        )
    return name


def _only(what: str, argument: str, candidates: Sequence[Topic], others: Sequence[Topic]) -> str:
    if len(candidates) == 1:
        return candidates[0].name
    if candidates:
        raise InputError(
            f"several topics may be {what}; name one as `{argument}`: {_listed(candidates)}"
        )
    raise InputError(f"no topic is {what}; name one as `{argument}`: {_listed(others)}")


def _listed(topics: Sequence[Topic]) -> str:
    return ", ".join(map(str, topics)) or "none"
