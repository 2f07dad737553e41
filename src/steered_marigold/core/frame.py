"""One view before its depth is completed: the record that every method and every source uses."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy.typing import NDArray
from torch import Tensor

from steered_marigold.core.colours import to_8_bits
from steered_marigold.core.doubts import scale_doubts
from steered_marigold.core.geometry import crop_intrinsics
from steered_marigold.core.notices import Notice, Notices
from steered_marigold.core.plausibility import FARTHEST, NEAREST, plausible_measurements
from steered_marigold.errors import InputError, SizeMismatchError

# modes of PIL images whose numbers are not red, green and blue, nor grey
_COLOUR_CODES = ("1", "P", "PA", "LA", "La", "CMYK", "YCbCr", "LAB", "HSV")


@dataclass(frozen=True, kw_only=True)
class Frame:
    """An image and what a sensor measured of its depth, all of one size.

    image: RGB in 0..255. sparse_depth: [m], z along the optical axis, 0 where valid_mask is False.
    valid_mask: where depth was measured. confidence: in [0, 1], the weight of each measurement;
    None: all weigh the same. K: intrinsics [px], if known. pose: the camera's place in the world,
    camera to world, 4x4 [m], if known. id: the frame's name among others. stamp: when it was taken
    [s], if known.
    missing: how many pixels of the depth that was read count as not measured, by reason.
    notices: what was read otherwise than written, or looks wrong.
    """

    image: UInt8[Tensor, "height width 3"]
    sparse_depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    confidence: Float[Tensor, "height width"] | None = None
    K: Float[Tensor, "3 3"] | None = None
    pose: Float[Tensor, "4 4"] | None = None
    id: str = ""
    stamp: float | None = None
    missing: Mapping[str, int] = field(default_factory=dict)
    notices: Notices = ()

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) [px]."""
        return self.image.shape[0], self.image.shape[1]

    @property
    def measured(self) -> bool:
        """Whether anything was measured."""
        return bool(self.valid_mask.any())

    def keep(self, mask: Bool[Tensor, "height width"]) -> "Frame":
        """With only the measurements where the mask is True; the depth elsewhere is zeroed."""
        valid = self.valid_mask & mask
        return replace(
            self, valid_mask=valid, sparse_depth=torch.where(valid, self.sparse_depth, 0.0)
        )

    def crop(self, rows: slice, columns: slice) -> "Frame":
        """The part in a rectangle of pixels; K moves along."""
        window = (rows, columns)
        confidence = None if self.confidence is None else self.confidence[window]
        K = self.K
        if K is not None:
            K = crop_intrinsics(K, top=rows.start, left=columns.start)
        return replace(
            self,
            image=self.image[window],
            sparse_depth=self.sparse_depth[window],
            valid_mask=self.valid_mask[window],
            confidence=confidence,
            K=K,
        )

    def motion_to(self, later: "Frame") -> Float[Tensor, "4 4"] | None:
        """Takes points [m] of this camera's frame to the later one's; None without both poses."""
        if self.pose is None or later.pose is None:
            return None
        motion: Tensor = torch.linalg.inv(later.pose.double()) @ self.pose.double()
        return motion.float()

    def plausible(self) -> "Frame":
        """Without measurements that can be no depths of one scene, which are counted and said."""
        found = plausible_measurements(self.sparse_depth, self.valid_mask)
        counts = {
            name: self.missing.get(name, 0) + getattr(found, name)
            for name in ("beyond_limits", "repeated", "absurd")
        }
        notices = self.notices
        if found.beyond_limits:
            text = (
                f"{found.beyond_limits} measurements are nearer than {NEAREST} m or farther than "
                f"{FARTHEST:g} m, which no depth is: left out"
            )
            notices += (Notice("beyond_limits", text),)
        if found.repeated:
            values = " and ".join(f"{value:.4g} m" for value in found.fills)
            text = f"{found.repeated} measurements of {values} are a fill, not depth: left out"
            notices += (Notice("fill", text),)
        if found.absurd:
            text = f"{found.absurd} measurements are far outside of what all others span: left out"
            notices += (Notice("absurd", text),)
        kept = self.keep(found.mask)
        return replace(kept, missing={**self.missing, **counts}, notices=notices)


def in_words(missing: Mapping[str, int]) -> str:
    """The reasons that there are pixels for: "12 zero, 3 beyond max depth"."""
    return ", ".join(f"{count} {why.replace('_', ' ')}" for why, count in missing.items() if count)


def make_frame(
    image: Any,
    sparse_depth: Any = None,
    valid_mask: Any = None,
    *,
    confidence: Any = None,
    K: Any = None,
    pose: Any = None,
    id: str = "",
    stamp: float | None = None,
) -> Frame:
    """A frame from arrays of any kind: NumPy, PyTorch, PIL, lists.

    image: [height, width, 3 or 4], [height, width] or [height, width, 1]; uint8, uint16, or floats
    in 0..1. sparse_depth: [m], [height, width], of any real type; None: nothing was measured.
    valid_mask: bool; None: where depth is finite and positive. confidence: in 0..1. K: 3x3.
    pose: 4x4, camera to world [m].

    Raises InputError or SizeMismatchError, naming the argument, for what is none of these.
    """
    pixels, notices = rgb_bytes(image)
    height, width = pixels.shape[:2]
    if sparse_depth is None:
        depth, valid = torch.zeros(height, width), torch.zeros(height, width, dtype=torch.bool)
    else:
        depth, valid = _measurements(sparse_depth, valid_mask)
    weights = None if confidence is None else _confidence(confidence)
    for name, values in (("sparse_depth", depth), ("confidence", weights)):
        if values is not None and tuple(values.shape) != (height, width):
            raise SizeMismatchError(
                f"`{name}` is {list(values.shape)} but the image {[height, width]} "
                "(height, width); they must agree"
            )
    return Frame(
        image=pixels,
        sparse_depth=depth,
        valid_mask=valid,
        confidence=weights,
        K=None if K is None else check_intrinsics(K),
        pose=None if pose is None else check_pose(pose),
        id=id,
        stamp=stamp,
        notices=notices + scale_doubts(depth, valid),
    )


def rgb_bytes(image: Any) -> tuple[UInt8[Tensor, "height width 3"], Notices]:
    """RGB in 0..255 from what `make_frame` takes as an image, and what was stretched for it.

    Alpha is dropped.

    Raises InputError, with what to do, for another shape, type or range.
    """
    if getattr(image, "mode", "RGB") in _COLOUR_CODES:
        image = image.convert("RGB")  # of PIL
    values = as_array("image", image)
    if values.ndim == 2:
        values = values[..., None]
    if values.ndim != 3 or values.shape[2] not in (1, 3, 4) or 0 in values.shape:
        hint = ""
        if values.ndim == 3 and values.shape[0] in (1, 3, 4):
            hint = "; it looks like channels first: use image.transpose(1, 2, 0)"
        raise InputError(f"`image` must be [height, width, 3], not {list(values.shape)}{hint}")
    if values.dtype.kind == "f":
        if not (values.min() >= 0 and values.max() <= 1):
            raise InputError(
                f"`image` has floats from {values.min():g} to {values.max():g}; "
                "floats must lie in 0..1, or give uint8"
            )
        values = np.rint(values * 255).astype(np.uint8)
    elif values.dtype not in (np.uint8, np.uint16):
        raise InputError(f"`image` must be uint8, uint16 or floats in 0..1, not {values.dtype}")
    values, notices = to_8_bits(values[..., 0] if values.shape[2] == 1 else values[..., :3])
    if values.ndim == 2:
        values = values[..., None].repeat(3, axis=2)
    return torch.from_numpy(np.array(values)), notices


def check_intrinsics(K: Any) -> Float[Tensor, "3 3"]:
    """K as float32; InputError unless it is [fx, skew, cx; 0, fy, cy; 0, 0, 1], fx and fy > 0."""
    matrix = as_array("K", K)
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "fiu" or not np.isfinite(matrix).all():
        raise InputError(f"`K` must be a finite 3x3 matrix [px], not {list(matrix.shape)}")
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and matrix[1, 0] == 0) or (
        matrix[2].tolist() != [0, 0, 1]
    ):
        raise InputError("`K` must be [fx, skew, cx; 0, fy, cy; 0, 0, 1], focal lengths positive")
    return torch.from_numpy(matrix.astype(np.float32))


def check_pose(pose: Any) -> Float[Tensor, "4 4"]:
    """A pose as float32; InputError unless it is a finite 4x4 with [0, 0, 0, 1] below."""
    matrix = as_array("pose", pose)
    if (
        matrix.shape != (4, 4)
        or not np.isfinite(matrix).all()
        or matrix[3].tolist() != [0, 0, 0, 1]
    ):
        raise InputError("`pose` must be a finite 4x4 matrix, camera to world, [0, 0, 0, 1] below")
    return torch.from_numpy(matrix.astype(np.float32))


def as_array(name: str, values: Any) -> NDArray[Any]:
    """NumPy's view of an array of any kind; InputError for what has no numbers."""
    if torch.is_tensor(values):
        values = values.detach().cpu()
        values = values.float() if values.dtype == torch.bfloat16 else values
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise InputError(f"`{name}` must be an array of numbers, not {type(values).__name__}")
    return array


def _measurements(sparse_depth: Any, valid_mask: Any) -> tuple[Tensor, Tensor]:
    values = as_array("sparse_depth", sparse_depth)
    if values.ndim != 2:
        raise InputError(f"`sparse_depth` must be [height, width], not {list(values.shape)}")
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows float32 is not finite
        depth = torch.from_numpy(values.astype(np.float32))
    measurable = torch.isfinite(depth) & (depth > 0)
    if valid_mask is None:
        return torch.where(measurable, depth, 0.0), measurable
    mask = as_array("valid_mask", valid_mask)
    if mask.shape != values.shape:
        raise SizeMismatchError(
            f"`valid_mask` is {list(mask.shape)} but `sparse_depth` {list(values.shape)}"
        )
    if mask.dtype.kind != "b" and not np.isin(mask, (0, 1)).all():
        raise InputError("`valid_mask` must be boolean: True where depth was measured")
    valid = torch.from_numpy(mask.astype(bool))
    if bool((valid & ~measurable).any()):
        raise InputError("`sparse_depth` must be finite and positive wherever `valid_mask` is True")
    return torch.where(valid, depth, 0.0), valid


def _confidence(confidence: Any) -> Tensor:
    values = as_array("confidence", confidence)
    if not ((values >= 0) & (values <= 1)).all():
        raise InputError("`confidence` must lie in 0..1; divide it by its largest value")
    return torch.from_numpy(values.astype(np.float32))
