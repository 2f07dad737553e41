"""What a method gets to see of a frame, and where its answer is scored.

All that is particular to a kind of protocol is its record in `KINDS`, and all that is particular to
a way of going wrong its record in `SPOILERS`; a new one is one more record. The samples of a frame
depend on the seed, the frame id and the protocol alone: never on the order of frames, on other
methods or on workers.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Generator, Tensor

from steered_marigold.core import sparsity
from steered_marigold.core.frame import Frame
from steered_marigold.core.geometry import center_crop
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.depth_files import DEPTH_SUFFIXES
from steered_marigold.io.depth_maps import read_depth

PAPER_CROP = (448, 608)
PAPER_FRACTION = 0.05
PAPER_AREAS = {"608x448": (448, 608), "408x248": (248, 408), "358x198": (198, 358)}
PAPER_ERASED = PAPER_AREAS["408x248"]
OPEN_AREAS = ("full", "measured", "hidden")
# a spoiled measurement is a wrong one from here on [m]; NYUv2's own steps are 4 cm
WRONG_M = 0.15


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is there to be measured.

    sample: the frame as the data set has it. truth: all of its depth, in the part that is shown.
    options: values by name. generator: draws the same numbers under every protocol.
    """

    sample: Sample
    truth: Frame
    options: Mapping[str, Any]
    generator: Generator


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of protocol.

    shows: what is measured, in words. measure: clean measurements of a scene. options: the names
        that it reads, with defaults; None is a default that `measure` knows. needs: those that
        must be given.
    crop: height and width [px] of the centre that is shown; None is all. windows: centred windows
        that are scored, by name; none stands for OPEN_AREAS. focus: the area that the protocol is
        about, by which frames are ranked.
    known_area: of the measurements, where an area with a clear border is measured; None if none is.
    """

    shows: str
    measure: Callable[[Scene], Frame]
    options: Mapping[str, Any] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    crop: tuple[int, int] | None = None
    windows: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    focus: str = "hidden"
    known_area: Callable[[Frame], Bool[Tensor, "height width"]] | None = None


def _uniform(scene: Scene) -> Frame:
    count = scene.options["points"] or sparsity.fraction_to_count(PAPER_FRACTION, PAPER_CROP)
    return sparsity.sample_uniform(scene.truth, count, generator=scene.generator)


def _erased(scene: Scene) -> Frame:
    return sparsity.erase_rectangle(_uniform(scene), *center_crop(PAPER_CROP, PAPER_ERASED))


def _given(scene: Scene) -> Frame:
    if not scene.sample.frame.measured:
        raise InputError("the data set holds no sparse depth; use another protocol than given")
    return scene.sample.frame


def _outside_holes(scene: Scene) -> Frame:
    """Outside the holes of one of the folder's depth maps, drawn at random, stretched to fit."""
    folder: Path = scene.options["masks"]
    paths = [path for path in sorted(folder.glob("*")) if path.suffix.lower() in DEPTH_SUFFIXES]
    paths = paths or sorted(folder.glob("*/depth.*"))
    if not paths:
        raise FileFormatError(f"{folder}: holds no depth maps to take holes from")
    chosen = paths[int(torch.randint(len(paths), (), generator=scene.generator))]
    mask = read_depth(chosen).valid_mask
    rows, columns = (
        torch.arange(new) * old // new
        for new, old in zip(scene.truth.valid_mask.shape, mask.shape, strict=True)
    )
    return scene.truth.keep(mask[rows[:, None], columns[None, :]])


def _all_but_erased(frame: Frame) -> Bool[Tensor, "height width"]:
    return ~_centre(frame.valid_mask, PAPER_ERASED)


def _measured(frame: Frame) -> Bool[Tensor, "height width"]:
    return frame.valid_mask


_PAPER = partial(Kind, options={"points": None}, crop=PAPER_CROP, windows=PAPER_AREAS)

KINDS: dict[str, Kind] = {
    "paper-uniform": _PAPER(
        shows="random samples of the 608x448 centre", measure=_uniform, focus="608x448"
    ),
    "paper-erased": _PAPER(
        shows="the same without those in the central 408x248",
        measure=_erased,
        focus="408x248",
        known_area=_all_but_erased,
    ),
    "range": Kind(
        shows="all depth up to a distance",
        measure=lambda s: sparsity.limit_range(s.truth, s.options["max_range"]),
        options={"max_range": 3.0},
        known_area=_measured,
    ),
    "half": Kind(
        shows="the nearer or farther half of all depth, or the lower or left half of the image",
        measure=lambda s: sparsity.keep_half(s.truth, s.options["keep"]),
        options={"keep": "near"},
        known_area=_measured,
    ),
    "lidar": Kind(
        shows="scan lines",
        measure=lambda s: sparsity.scan_lines(s.truth, s.options["lines"], generator=s.generator),
        options={"lines": 64},
    ),
    "objects": Kind(
        shows="all depth but three large ellipses",
        measure=lambda s: sparsity.remove_blobs(s.truth, 3, generator=s.generator),
        known_area=_measured,
    ),
    "shape": Kind(  # the side that Prior-Depth-Anything's programs call cubic_150
        shows="all depth but a square of 150 px",
        measure=lambda s: sparsity.remove_square(s.truth, 150, generator=s.generator),
        known_area=_measured,
    ),
    "region": Kind(
        shows="all but a connected third of the measured area, for frames without dense truth",
        measure=lambda s: sparsity.remove_region(s.truth, 1 / 3, generator=s.generator),
        known_area=_measured,
    ),
    "sensor": Kind(
        shows="all depth outside the holes of a real depth map",
        measure=_outside_holes,
        options={"masks": None},
        needs=("masks",),
    ),
    "dense": Kind(shows="all depth, to be spoiled", measure=lambda s: s.truth, focus="full"),
    "given": Kind(shows="the data set's own sparse depth", measure=_given, focus="full"),
}

# how measurements go wrong: (measurements, all depth, option, generator) -> measurements; in order
Spoil = Callable[[Frame, Frame, Any, Generator], Frame]
SPOILERS: dict[str, Spoil] = {
    "noise": lambda m, _, sigma, g: sparsity.add_noise(m, sigma, generator=g),
    "outliers": lambda m, _, share, g: sparsity.add_outliers(m, share, generator=g),
    "flying_pixels": lambda m, truth, share, g: sparsity.add_flying_pixels(
        m, truth, share, least=WRONG_M, generator=g
    ),
    "patches": lambda m, _, count, g: sparsity.add_patches(m, count, generator=g),
}


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """How measurements are made from a frame.

    kind: one of KINDS, whose `shows` says what is measured.
    points: samples drawn; None is 5 % of all pixels (13 619 of 608x448). max_range: [m]. keep:
        near, far, bottom or left. lines: scan lines. masks: a folder of depth maps, or of folders
        with a depth map named depth. None is the kind's default.
    noise: standard deviation as a fraction of the depth. outliers: fraction of the measurements
        that is replaced by depths uniform in 0.3 to 10 m. flying_pixels: fraction of the
        measurements at depth edges that becomes a mixture of both sides. patches: number of
        connected regions of 50 to 2000 px with false depth.

    Raises InputError for an unknown kind, or an option that the kind does not read.
    """

    kind: str
    points: int | None = None
    max_range: float | None = None
    keep: str | None = None
    lines: int | None = None
    masks: Path | None = None
    noise: float = 0.0
    outliers: float = 0.0
    flying_pixels: float = 0.0
    patches: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"protocol {self.kind!r} is not known; use one of {', '.join(KINDS)}")
        for option in {name for kind in KINDS.values() for name in kind.options}:
            value = getattr(self, option)
            if value is not None and option not in self.record.options:
                raise InputError(f"protocol {self.kind} does not read {option}; leave it out")
            if isinstance(value, int | float) and value <= 0:
                raise InputError(f"{option} must be positive, not {value}")
        for option in self.record.needs:
            if getattr(self, option) is None:
                raise InputError(f"protocol {self.kind} needs {option}: see Protocol")
        if self.keep is not None and self.keep not in sparsity.HALVES:
            raise InputError(f"keep {self.keep!r}: choose one of {', '.join(sparsity.HALVES)}")
        if self.noise < 0 or self.patches < 0:
            raise InputError("noise and patches must not be negative")
        if not (0 <= self.outliers <= 1 and 0 <= self.flying_pixels <= 1):
            raise InputError("outliers and flying_pixels must lie in [0, 1]")

    @property
    def record(self) -> Kind:
        """What is particular to the kind."""
        return KINDS[self.kind]

    @property
    def options(self) -> dict[str, Any]:
        """The kind's options, with its defaults where none is given."""
        given = {name: getattr(self, name) for name in self.record.options}
        return {k: self.record.options[k] if v is None else v for k, v in given.items()}

    @property
    def name(self) -> str:
        """The kind and whatever differs from its defaults, e.g. "lidar-16+noise-0.1"."""
        given = (getattr(self, option) for option in self.record.options)
        changes = [f"-{x}" if isinstance(x, str) else f"-{x:g}" for x in given if _is_shown(x)]
        wrong = {spoiler: getattr(self, spoiler) for spoiler in SPOILERS}
        changes += [f"+{spoiler}-{x:g}" for spoiler, x in wrong.items() if x]
        return self.kind + "".join(changes)

    @property
    def from_paper(self) -> bool:
        """Whether frames are cropped and scored as in the paper."""
        return self.record.crop is not None

    @property
    def bordered(self) -> bool:
        """Whether an area with a clear border is measured."""
        return self.record.known_area is not None

    @property
    def areas(self) -> tuple[str, ...]:
        """Where answers are scored."""
        return tuple(self.record.windows) or OPEN_AREAS

    @property
    def focus(self) -> str:
        """The area that the protocol is about, by which frames are ranked."""
        return self.record.focus


def _is_shown(value: Any) -> bool:
    """Whether an option's value is part of a protocol's name; a folder's is not."""
    return isinstance(value, str | int | float)


@dataclass(frozen=True, kw_only=True)
class PreparedFrame:
    """A frame as a protocol shows it to every method, and where answers to it are scored.

    shown: image and measurements. metric_depth: the truth [m]. areas: the pixels to score, by area,
    all of them with a truth. focus: the area that the protocol is about. known_area: where the
    protocol measures, if that is an area with a clear border. wrong: the measurements that a
    spoiler (noise apart) moved by more than WRONG_M; None if the protocol spoils none.
    """

    shown: Frame
    metric_depth: Float[Tensor, "height width"]
    areas: Mapping[str, Bool[Tensor, "height width"]]
    focus: str
    known_area: Bool[Tensor, "height width"] | None
    wrong: Bool[Tensor, "height width"] | None = None


def prepare(sample: Sample, protocol: Protocol, *, seed: int) -> PreparedFrame:
    """The frame as the protocol shows it.

    Raises SizeMismatchError for a frame smaller than the paper's crop under its protocols,
    InputError if "given" measurements are wanted and the data set has none.
    """
    kind, truth = protocol.record, sample.truth
    if kind.crop is not None:
        truth = truth.crop(*center_crop(truth.size, kind.crop))
    scene = Scene(
        sample=sample,
        truth=truth,
        options=protocol.options,
        generator=frame_generator(seed, truth.id, "samples"),
    )
    shown, wrong = _spoil(kind.measure(scene), scene, protocol, seed)
    valid, seen = truth.valid_mask, shown.valid_mask
    if kind.windows:
        areas = {name: valid & _centre(valid, size) for name, size in kind.windows.items()}
    else:
        areas = dict(zip(OPEN_AREAS, (valid, valid & seen, valid & ~seen), strict=True))
    return PreparedFrame(
        shown=shown,
        metric_depth=truth.sparse_depth,
        areas=areas,
        focus=protocol.focus,
        known_area=None if kind.known_area is None else kind.known_area(shown),
        wrong=wrong,
    )


def frame_generator(seed: int, frame_id: str, purpose: str) -> Generator:
    """A generator that depends on these three alone."""
    digest = hashlib.sha256(f"{seed}/{frame_id}/{purpose}".encode()).digest()
    return Generator().manual_seed(int.from_bytes(digest[:7], "big"))


def _spoil(
    frame: Frame, scene: Scene, protocol: Protocol, seed: int
) -> tuple[Frame, Bool[Tensor, "height width"] | None]:
    """The frame with all that the protocol does to them, and which measurements became wrong."""
    wrong = None
    for spoiler, spoil in SPOILERS.items():
        value = getattr(protocol, spoiler)
        if not value:
            continue
        generator = frame_generator(seed, frame.id, spoiler)
        spoiled = spoil(frame, scene.truth, value, generator)
        if spoiler != "noise":
            moved = (spoiled.sparse_depth - frame.sparse_depth).abs() > WRONG_M
            wrong = moved if wrong is None else wrong | moved
        frame = spoiled
    return frame, wrong


def _centre(
    like: Bool[Tensor, "height width"], size: tuple[int, int]
) -> Bool[Tensor, "height width"]:
    """True in the centred window of `size` (height, width)."""
    mask = torch.zeros_like(like)
    mask[center_crop((like.shape[0], like.shape[1]), size)] = True
    return mask
