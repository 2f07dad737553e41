"""Which image belongs to which depth map, by their names alone."""

import re
from collections.abc import Callable, Hashable, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steered_marigold.errors import InputError
from steered_marigold.io.files import AnyPath, decoding, require_file, split_name

_COLOUR_WORDS = frozenset(
    ("color", "colour", "colors", "rgb", "image", "images", "img", "photo", "infrared", "ir", "col")
)
_DEPTH_WORDS = frozenset(
    ("depth", "depths", "dep", "dpt", "d", "z", "disp", "disparity", "depthmap", "velodyne")
)
_KINDS = _COLOUR_WORDS | _DEPTH_WORDS | {"raw", "aligned", "to", "registered", "map"}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_DECIMAL_STAMP = re.compile(r"(?:^|\D)(\d+\.\d+)$")
_WHOLE_STAMP = re.compile(r"(?:^|\D)(\d{10,20})(?:\D|$)")
# seconds since 1970 have 10 digits, and each finer unit three more
_STAMP_UNITS = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
_SHOWN = 5

Pairs = dict[str, str]  # image: depth map
_Key = Callable[[str], Hashable | None]  # of a stem


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """pairs: image to depth map, in the order of the images. unpaired: images, depth maps alone.

    rule: how they were found, as words that complete "paired by".
    """

    pairs: Pairs
    unpaired: tuple[list[str], list[str]]
    rule: str


def pair_files(
    images: Sequence[str],
    depths: Sequence[str],
    *,
    one_folder: bool = False,
    slop: float = 0.02,
    associations: AnyPath | None = None,
) -> Pairing:
    """Pairs files, given by their names, by the rule that finds most pairs; at a tie by the first.

    Equal stems; names that are equal without words such as color and depth; a common number; time
    stamps at most `slop` seconds apart. With `associations`, by that file alone: lines of "stamp
    image stamp depth" (TUM's associations.txt), or a folder that holds rgb.txt and depth.txt.
    one_folder: both are of the same one; then names with a word such as depth are depth maps.

    Raises InputError, with the candidates, where a rule finds several partners for a file and no
    other rule pairs as many; and where there is no pair.
    """
    if not 0 <= slop < float("inf"):
        raise InputError(f"`slop` is a time in seconds, at least 0, not {slop}")
    if one_folder:
        images, depths = _told_apart(images, depths)
    if associations is not None:
        pairs = _by_associations(images, depths, Path(associations), slop)
        return _pairing(pairs, images, depths, "the association file")
    best, best_rule, ambiguous = Pairs(), "", ""
    most = min(len(images), len(depths))
    for rule, key in _KEYS.items():
        pairs, doubtful = _by_key(images, depths, key)
        if doubtful:
            ambiguous = ambiguous or f"{rule}: {doubtful}"
        elif len(pairs) > len(best):
            best, best_rule = pairs, rule
        if len(best) == most:
            break
    stamped = {} if len(best) == most else _by_stamps(images, depths, slop)
    if len(stamped) > len(best):
        best, best_rule = stamped, f"time stamps within {slop:g} s"
    if not best and ambiguous:
        raise InputError(f"files could be paired in several ways, by {ambiguous}; rename or remove")
    if not best:
        raise InputError(_advice(images, depths))
    return _pairing(best, images, depths, best_rule)


def _pairing(pairs: Pairs, images: Sequence[str], depths: Sequence[str], rule: str) -> Pairing:
    unpaired = _left(images, set(pairs)), _left(depths, set(pairs.values()))
    ordered = {image: pairs[image] for image in sorted(pairs)}
    return Pairing(pairs=ordered, unpaired=unpaired, rule=rule)


def _left(names: Sequence[str], taken: Set[str]) -> list[str]:
    return sorted(name for name in names if name not in taken)


def _told_apart(images: Sequence[str], depths: Sequence[str]) -> tuple[list[str], list[str]]:
    """Files that are in both lists go to one of them, by a word in their name."""
    common = set(images) & set(depths)
    of_depth = {name for name in common if _names_depth(_stem(name))}
    pictures = [name for name in images if name not in of_depth]
    if common and not (of_depth and pictures):
        some = ", ".join(sorted(common)[:_SHOWN])
        raise InputError(
            f"the same files are given as images and as depth maps ({some}); give two folders, or "
            "name them as 0001_color and 0001_depth"
        )
    return pictures, [name for name in depths if name not in common - of_depth]


def _stem(name: str) -> str:
    return split_name(name)[0]


def _names_depth(stem: str) -> bool:
    return any(word.lower() in _DEPTH_WORDS for word in _WORDS.findall(stem))


def _without_kind(stem: str) -> Hashable | None:
    """The words and numbers of a name, without those that say what it shows."""
    words = (word.lower() for word in _WORDS.findall(stem))
    return " ".join(word for word in words if word not in _KINDS) or None


def _number(place: int) -> _Key:
    """The first (0) or last (-1) whole number of a name; none in names that end in seconds."""

    def key(stem: str) -> Hashable | None:
        numbers = re.findall(r"\d+", stem)
        return int(numbers[place]) if numbers and not _DECIMAL_STAMP.search(stem) else None

    return key


_KEYS: dict[str, _Key] = {
    "equal stems": lambda stem: stem,
    "names that differ only in words such as color and depth": _without_kind,
    "their last number": _number(-1),
    "their first number": _number(0),
}


def _by_key(images: Sequence[str], depths: Sequence[str], key: _Key) -> tuple[Pairs, str]:
    """Pairs of equal key.

    If a key has several files on a side there are none; then the first such files are named.
    """
    first: dict[Hashable, str] = {}
    repeated, doubtful = set[Hashable](), set[Hashable]()
    for image in images:
        value = key(_stem(image))
        if value in first:
            repeated.add(value)
        elif value is not None:
            first[value] = image
    pairs = Pairs()
    for depth in depths:
        value = key(_stem(depth))
        if value in first:
            if value in repeated or first[value] in pairs:
                doubtful.add(value)
            pairs[first[value]] = depth
    if not doubtful:
        return pairs, ""
    example = next(value for image in images if (value := key(_stem(image))) in doubtful)
    sides = (
        sorted(name for name in names if key(_stem(name)) == example)[:_SHOWN]
        for names in (images, depths)
    )
    return {}, " and ".join(", ".join(names) for names in sides)


def _by_stamps(images: Sequence[str], depths: Sequence[str], slop: float) -> Pairs:
    """Pairs of names that are times; each file once, the closest first, as TUM's associate.py."""
    ours, our_times = _timed(images)
    theirs, their_times = _timed(depths)
    return {ours[i]: theirs[j] for i, j in _closest(our_times, their_times, slop)}


def _closest(ours: np.ndarray, theirs: np.ndarray, slop: float) -> list[tuple[int, int]]:
    """Indices into two rising arrays of seconds that are at most `slop` apart, each used once."""
    tolerance = slop + 1e-6  # what float64 cannot hold of seconds since 1970
    first = np.searchsorted(theirs, ours - tolerance, "left")
    counts = np.searchsorted(theirs, ours + tolerance, "right") - first
    i = np.repeat(np.arange(len(ours)), counts)
    j = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + first[i]
    used_i, used_j, found = set[int](), set[int](), []
    for at in np.argsort(np.abs(ours[i] - theirs[j]), kind="stable"):
        pair = int(i[at]), int(j[at])
        if pair[0] not in used_i and pair[1] not in used_j:
            used_i.add(pair[0])
            used_j.add(pair[1])
            found.append(pair)
    return found


def _timed(names: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """The files whose names hold a time, and those times [s], rising."""
    timed = sorted((time, name) for name in names if (time := _seconds(_stem(name))) is not None)
    return [name for _, name in timed], np.array([time for time, _ in timed], np.float64)


def _seconds(stem: str) -> float | None:
    if (decimal := _DECIMAL_STAMP.search(stem)) is not None:
        return float(decimal[1])
    whole = _WHOLE_STAMP.search(stem)
    unit = _STAMP_UNITS.get(len(whole[1])) if whole is not None else None
    return None if whole is None or unit is None else int(whole[1]) * unit


def _by_associations(
    images: Sequence[str], depths: Sequence[str], file: Path, slop: float
) -> Pairs:
    """The pairs that a file names; its paths are looked up by their last part."""
    if file.is_dir():
        colour, depth = (_listed(file / name) for name in ("rgb.txt", "depth.txt"))
        times = (np.array([time for time, _ in listed]) for listed in (colour, depth))
        found = _closest(next(times), next(times), slop)
        named = [(colour[i][1], depth[j][1]) for i, j in found]
    else:
        rows = [line.split() for line in _lines(file)]
        if any(len(row) not in (2, 4) for row in rows):
            raise InputError(f"{file}: each line is `stamp image stamp depth`, or `image depth`")
        named = [(row[-3] if len(row) == 4 else row[0], row[-1]) for row in rows]
    ours, theirs = set(images), set(depths)
    pairs = Pairs()
    for one, other in named:
        names = Path(one).name, Path(other).name
        if names[0] in theirs and names[0] not in ours:  # depth comes first in some files
            names = names[1], names[0]
        if names[0] in ours and names[1] in theirs:
            pairs[names[0]] = names[1]
    if not pairs:
        raise InputError(f"{file}: names none of the given files in pairs")
    return pairs


def _listed(file: Path) -> list[tuple[float, str]]:
    """(seconds, name) of lines as "1305031229.528748 rgb/1305031229.528748.png", rising."""
    rows = [line.split(maxsplit=1) for line in _lines(file)]
    with decoding(file):
        return sorted((float(time), name) for time, name in rows)


def _lines(file: Path) -> list[str]:
    file = require_file(file)
    with decoding(file):
        lines = (line.strip() for line in file.read_text(encoding="utf-8-sig").splitlines())
        return [line for line in lines if line and not line.startswith("#")]


def _advice(images: Sequence[str], depths: Sequence[str]) -> str:
    """Why there is no pair, and what would help."""
    if not images or not depths:
        return f"no {'images' if not images else 'depth maps'} were found to pair"
    example = f"{min(images)} and {min(depths)}"
    (_, ours), (_, theirs) = _timed(images), _timed(depths)
    if len(ours) and len(theirs):
        after = np.searchsorted(theirs, ours)
        sides = (theirs[np.clip(place, 0, len(theirs) - 1)] for place in (after - 1, after))
        gaps = np.min([np.abs(side - ours) for side in sides], axis=0)
        return (
            f"no image has a depth map within `slop`: the closest time stamps are {gaps.min():.3g} "
            f"s apart ({example}); give a larger `slop`, or `associations`"
        )
    return (
        f"no image can be paired with a depth map by name ({example}); name them alike, as "
        "0001.jpg and 0001.png, or give `associations`, a file of `image depth` lines"
    )
