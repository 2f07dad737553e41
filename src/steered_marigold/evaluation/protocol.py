"""What a method gets to see of a frame, and where its answer is scored.

The samples of a frame depend on the seed, the frame id and the protocol alone: never on the order
of frames, on other methods or on workers.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Generator, Tensor

from steered_marigold.core import sparsity
from steered_marigold.core.geometry import center_crop, crop_intrinsics
from steered_marigold.core.sparsity import Measurements
from steered_marigold.datasets.sample import RgbdSample
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.depth_files import DEPTH_SUFFIXES
from steered_marigold.io.depth_maps import read_depth

KINDS = (
    *("paper-uniform", "paper-erased"),
    *("range", "lidar", "objects", "region", "sensor", "given"),
)
PAPER_CROP = (448, 608)
PAPER_FRACTION = 0.05
PAPER_AREAS = {"608x448": (448, 608), "408x248": (248, 408), "358x198": (198, 358)}
PAPER_ERASED = PAPER_AREAS["408x248"]
OPEN_AREAS = ("full", "measured", "hidden")

_READ_BY = {
    "points": ("paper-uniform", "paper-erased"),
    "max_range": ("range",),
    "lines": ("lidar",),
    "masks": ("sensor",),
}
_MAX_RANGE_M = 3.0
_LINES = 64
_BLOBS = 3
_REGION = 1 / 3  # of the measured area
_BORDERED = ("paper-erased", "range", "objects", "region")


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """How measurements are made from a frame.

    kind: "paper-uniform", random samples in the 608x448 centre crop; "paper-erased", the same
        without those in the central 408x248; "range", all depth up to max_range; "lidar", scan
        lines; "objects", all depth but three large blobs; "region", all depth but a connected
        third of the measured area, for frames without dense truth; "sensor", all depth outside the
        holes of a real depth map; "given", what the data set itself holds.
    points: samples drawn; None is 5 % of all pixels (13 619 of 608x448).
    max_range: [m], None is 3. lines: scan lines, None is 64.
    masks: a folder of depth maps, or of folders with a depth map named depth.
    noise: standard deviation as a fraction of the depth. outliers: fraction of the measurements
        that is replaced by depths uniform in 0.3 to 10 m.

    Raises InputError for an unknown kind, or an option that the kind does not read.
    """

    kind: str
    points: int | None = None
    max_range: float | None = None
    lines: int | None = None
    masks: Path | None = None
    noise: float = 0.0
    outliers: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"protocol {self.kind!r} is not known; use one of {', '.join(KINDS)}")
        for option, kinds in _READ_BY.items():
            value = getattr(self, option)
            if value is not None and self.kind not in kinds:
                raise InputError(f"protocol {self.kind} does not read {option}; leave it out")
            if isinstance(value, int | float) and value <= 0:
                raise InputError(f"{option} must be positive, not {value}")
        if self.kind == "sensor" and self.masks is None:
            raise InputError("protocol sensor needs masks, a folder of real depth maps")
        if self.noise < 0 or not 0 <= self.outliers <= 1:
            raise InputError("noise must not be negative, and outliers must lie in [0, 1]")

    @property
    def name(self) -> str:
        """The kind and whatever differs from its defaults, e.g. "lidar-16+noise-0.1"."""
        value = self.points or self.max_range or self.lines
        changes = [f"-{value:g}"] if value else []
        changes += [f"+{x}-{getattr(self, x):g}" for x in ("noise", "outliers") if getattr(self, x)]
        return self.kind + "".join(changes)

    @property
    def from_paper(self) -> bool:
        """Whether frames are cropped and scored as in the paper."""
        return self.kind.startswith("paper-")

    @property
    def bordered(self) -> bool:
        """Whether an area with a clear border is measured."""
        return self.kind in _BORDERED

    @property
    def areas(self) -> tuple[str, ...]:
        """Where answers are scored."""
        return tuple(PAPER_AREAS) if self.from_paper else OPEN_AREAS

    @property
    def focus(self) -> str:
        """The area that the protocol is about, by which frames are ranked."""
        whole = {"paper-uniform": "608x448", "paper-erased": "408x248", "given": "full"}
        return whole.get(self.kind, "hidden")


@dataclass(frozen=True, kw_only=True)
class PreparedFrame:
    """A frame as a protocol shows it to every method.

    image: RGB in 0..255. measurements: [m]. K: intrinsics [px], if known. depth: the truth [m].
    areas: the pixels to score, by area, all of them with a truth. focus: the area that the protocol
    is about. known_area: where the protocol measures, if that is an area with a clear border.
    """

    frame_id: str
    image: UInt8[Tensor, "height width 3"]
    measurements: Measurements
    K: Float[Tensor, "3 3"] | None
    depth: Float[Tensor, "height width"]
    areas: Mapping[str, Bool[Tensor, "height width"]]
    focus: str
    known_area: Bool[Tensor, "height width"] | None


def prepare(sample: RgbdSample, protocol: Protocol, *, seed: int) -> PreparedFrame:
    """The frame as the protocol shows it.

    Raises SizeMismatchError for a frame smaller than the paper's crop under its protocols,
    InputError if "given" measurements are wanted and the data set has none.
    """
    height, width = sample.depth.shape
    rows, columns = slice(0, height), slice(0, width)
    if protocol.from_paper:
        rows, columns = center_crop((height, width), PAPER_CROP)
    depth, valid = sample.depth[rows, columns], sample.valid_mask[rows, columns]
    truth = Measurements(sparse_depth=depth, valid_mask=valid)
    measurements = _spoil(_measure(sample, truth, protocol, seed), sample.frame_id, protocol, seed)
    if protocol.from_paper:
        areas = {name: valid & _centre(depth, size) for name, size in PAPER_AREAS.items()}
    else:
        seen = measurements.valid_mask
        areas = dict(zip(OPEN_AREAS, (valid, valid & seen, valid & ~seen), strict=True))
    K = sample.K
    return PreparedFrame(
        frame_id=sample.frame_id,
        image=sample.image[rows, columns],
        measurements=measurements,
        K=None if K is None else crop_intrinsics(K, top=rows.start, left=columns.start),
        depth=depth,
        areas=areas,
        focus=protocol.focus,
        known_area=_known_area(measurements, protocol),
    )


def frame_generator(seed: int, frame_id: str, purpose: str) -> Generator:
    """A generator that depends on these three alone."""
    digest = hashlib.sha256(f"{seed}/{frame_id}/{purpose}".encode()).digest()
    return Generator().manual_seed(int.from_bytes(digest[:7], "big"))


def _measure(
    sample: RgbdSample, truth: Measurements, protocol: Protocol, seed: int
) -> Measurements:
    """Clean measurements; whatever is random draws from the same numbers under every protocol."""
    generator = frame_generator(seed, sample.frame_id, "samples")
    size = (truth.sparse_depth.shape[0], truth.sparse_depth.shape[1])
    if protocol.from_paper:
        count = protocol.points or sparsity.fraction_to_count(PAPER_FRACTION, size)
        samples = sparsity.sample_uniform(truth, count, generator=generator)
        if protocol.kind == "paper-erased":
            return sparsity.erase_rectangle(samples, *center_crop(size, PAPER_ERASED))
        return samples
    if protocol.kind == "range":
        return sparsity.limit_range(truth, protocol.max_range or _MAX_RANGE_M)
    if protocol.kind == "lidar":
        return sparsity.scan_lines(truth, protocol.lines or _LINES, generator=generator)
    if protocol.kind == "objects":
        return sparsity.remove_blobs(truth, _BLOBS, generator=generator)
    if protocol.kind == "region":
        return sparsity.remove_region(truth, _REGION, generator=generator)
    if protocol.masks is not None:
        return sparsity.keep(truth, _sensor_mask(protocol.masks, size, generator))
    if sample.sparse_depth is None or sample.sparse_mask is None:
        raise InputError("the data set holds no sparse depth; use another protocol than given")
    return Measurements(sparse_depth=sample.sparse_depth, valid_mask=sample.sparse_mask)


def _known_area(
    measurements: Measurements, protocol: Protocol
) -> Bool[Tensor, "height width"] | None:
    """All pixels outside the erased centre, or all that were measured."""
    if protocol.kind == "paper-erased":
        return ~_centre(measurements.sparse_depth, PAPER_ERASED)
    return measurements.valid_mask if protocol.bordered else None


def _spoil(
    measurements: Measurements, frame_id: str, protocol: Protocol, seed: int
) -> Measurements:
    """The measurements with the protocol's noise, then its outliers."""
    if protocol.noise:
        generator = frame_generator(seed, frame_id, "noise")
        measurements = sparsity.add_noise(measurements, protocol.noise, generator=generator)
    if protocol.outliers:
        generator = frame_generator(seed, frame_id, "outliers")
        measurements = sparsity.add_outliers(measurements, protocol.outliers, generator=generator)
    return measurements


def _centre(
    depth: Float[Tensor, "height width"], size: tuple[int, int]
) -> Bool[Tensor, "height width"]:
    """True in the centred window of `size` (height, width)."""
    mask = torch.zeros_like(depth, dtype=torch.bool)
    mask[center_crop((depth.shape[0], depth.shape[1]), size)] = True
    return mask


def _sensor_mask(
    folder: Path, size: tuple[int, int], generator: Generator
) -> Bool[Tensor, "height width"]:
    """Where one of the folder's depth maps, drawn at random, is valid; stretched to `size`."""
    paths = [path for path in sorted(folder.glob("*")) if path.suffix.lower() in DEPTH_SUFFIXES]
    paths = paths or sorted(folder.glob("*/depth.*"))
    if not paths:
        raise FileFormatError(f"{folder}: holds no depth maps to take holes from")
    chosen = paths[int(torch.randint(len(paths), (), generator=generator))]
    mask = read_depth(chosen).valid_mask
    rows, columns = (
        torch.arange(new) * old // new for new, old in zip(size, mask.shape, strict=True)
    )
    return mask[rows[:, None], columns[None, :]]
