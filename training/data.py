"""Frames of all kinds as training samples: read, cropped, turned, recoloured, normalised.

A sample is an image uint8 [3, 240, 320], an affine-invariant depth float32 [1, 240, 320], where it
is known, bool [1, 240, 320], and its range float32 [2] in metres. The 2 % and 98 % percentiles of
what is known map to -1 and 1 and the rest is clipped, as in Marigold (Ke et al., CVPR 2024,
Eq. 3). The sky is at 1. Holes hold the nearest known depth, for the codec's sake; no error is
measured there.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import torch
from scipy import ndimage

WIDTH, HEIGHT = 320, 240
SPLITS = Path(__file__).parent / "splits"
# dataset indices that must lie between a training frame and any held-out frame
GAP = 5
# the outermost pixels of NYUv2 frames are a white frame with in-painted depth
NYU_BORDER = 8
# standard deviation of the angle by which a crop is turned [degrees]
TURN = 4.0
# depth [mm] of the sky: the far end of the scale
SKY = 65535
# of a sample, at least this much must be known
LEAST_KNOWN = 0.25

Image = npt.NDArray[np.uint8]
Depth = npt.NDArray[np.uint16]


@dataclass(frozen=True)
class Frame:
    """image: RGB [height, width, 3]; depth: mm [height, width], 0 = unknown, SKY = infinity."""

    image: Image
    depth: Depth


def read_split(name: str) -> list[int]:
    """The frame indices of "tune" or "report", ascending."""
    return [int(line) for line in (SPLITS / f"{name}.txt").read_text().split()]


def training_indices(folder: Path) -> list[int]:
    """All frames of an NYUv2 folder far enough from every held-out frame."""
    held_out = read_split("tune") + read_split("report")
    frames = sorted(int(path.stem) for path in (folder / "depth").glob("*.png"))
    return [i for i in frames if min(abs(i - j) for j in held_out) > GAP]


def read_frame(image_path: Path, depth_path: Path) -> Frame:
    """A picture and its depth in uint16 millimetres. Raises FileNotFoundError."""
    image = cv2.imread(str(image_path))
    depth = cv2.imread(str(depth_path), cv2.IMREAD_UNCHANGED)
    if image is None or depth is None:
        raise FileNotFoundError(f"{image_path} or {depth_path}")
    image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return Frame(np.asarray(image, np.uint8), np.asarray(depth, np.uint16))


def read_nyu_frame(folder: Path, index: int) -> Frame:
    """One frame of `shared/data/nyuv2_train`."""
    name = f"{index:04d}"
    return read_frame(folder / "rgb" / f"{name}.jpg", folder / "depth" / f"{name}.png")


def depth_range(depth: npt.NDArray[np.floating[Any]]) -> tuple[float, float]:
    """The depths [m] that map to -1 and 1: the 2 % and the 98 % percentile of what is known.

    depth: 0 where nothing is known; the sky counts as known for nothing.
    """
    low, high = np.percentile(depth[(depth > 0) & (depth < SKY / 1000)], (2, 98))
    return float(low), float(high)


def normalise(depth: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float32]:
    """Affine-invariant depth in [-1, 1]; where it is 0, that of the nearest known pixel."""
    low, high = depth_range(depth)
    hole = depth == 0
    if hole.any():
        nearest = ndimage.distance_transform_edt(hole, return_distances=False, return_indices=True)
        depth = depth[tuple(nearest)]
    scaled = 2 * (depth - low) / max(high - low, 1e-3) - 1
    return np.asarray(np.clip(scaled, -1, 1), np.float32)


def resized(frame: Frame) -> Frame:
    """The frame at the training size; no depth is mixed from two."""
    image = cv2.resize(frame.image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    depth = cv2.resize(frame.depth, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    return Frame(np.asarray(image, np.uint8), np.asarray(depth, np.uint16))


def composite(frame: Frame, other: Frame, rng: np.random.Generator) -> Frame:
    """The frame with near things of another one, of the same camera, in front: cut and paste.

    What is pasted hides only what is farther by a quarter, so depth stays consistent.
    """
    image, depth = other.image, other.depth
    if rng.random() < 0.5:
        image, depth = image[:, ::-1], depth[:, ::-1]
    known = depth > 0
    if not known.any():
        return frame
    near = float(np.quantile(depth[known], rng.uniform(0.1, 0.45)))
    over = known & (depth < near) & ((depth < 0.8 * frame.depth) | (frame.depth == 0))
    over = cv2.morphologyEx(over.astype(np.uint8), cv2.MORPH_OPEN, np.ones((9, 9), np.uint8)) > 0
    pasted = np.where(over[..., None], image, frame.image)
    return Frame(np.asarray(pasted, np.uint8), np.where(over, depth, frame.depth))


def augment(frame: Frame, border: int, rng: np.random.Generator) -> Frame:
    """A random crop, turned a little, mirrored or not, at the training size, in other colours."""
    crop = _random_crop(frame, border, rng)
    image, depth = crop.image, crop.depth
    if rng.random() < 0.5:
        image, depth = image[:, ::-1], depth[:, ::-1]
    return Frame(_recolour(image, rng), np.ascontiguousarray(depth))


def _random_crop(frame: Frame, border: int, rng: np.random.Generator) -> Frame:
    """A box of the frame without its border, turned by some degrees, at the training size."""
    inner = np.array(frame.depth.shape[::-1]) - 2 * border
    sides = inner * rng.uniform(0.55, 1.0) * rng.uniform(0.9, 1.0, size=2)
    angle = np.deg2rad(rng.normal(0, TURN))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    around = np.abs(turn) @ sides  # the upright box around the turned one
    shrink = min(1.0, float((inner / around).min()))
    sides, around = sides * shrink, around * shrink
    centre = border + around / 2 + rng.random(2) * (inner - around)

    def warped(source: npt.NDArray[Any], scale: int, interpolation: int) -> npt.NDArray[Any]:
        size = np.array([WIDTH, HEIGHT]) * scale
        linear = turn * (sides / size)
        # pixel centres lie at halves
        shift = centre - turn @ sides / 2 + linear.sum(axis=1) / 2 - 0.5
        matrix = np.column_stack([linear, shift])
        flags = interpolation | cv2.WARP_INVERSE_MAP
        border_mode = cv2.BORDER_REPLICATE
        size = size.tolist()
        return np.asarray(
            cv2.warpAffine(source, matrix, size, flags=flags, borderMode=border_mode), source.dtype
        )

    image = warped(frame.image, 2, cv2.INTER_LINEAR)
    image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return Frame(np.asarray(image, np.uint8), warped(frame.depth, 1, cv2.INTER_NEAREST))


def _recolour(image: Image, rng: np.random.Generator) -> Image:
    """Random exposure, contrast, white balance and saturation, sometimes noise, blur or grey."""
    x = image.astype(np.float32) / 255
    if rng.random() < 0.8:
        grey = x.mean(axis=2, keepdims=True)
        saturation = 0.0 if rng.random() < 0.06 else rng.uniform(0.5, 1.4)
        x = grey + (x - grey) * saturation
        x *= rng.uniform(0.88, 1.12, size=3).astype(np.float32) * rng.uniform(0.7, 1.35)
        x = (x - 0.5) * rng.uniform(0.75, 1.25) + 0.5
        x = np.clip(x, 0, 1) ** rng.uniform(0.75, 1.35)
    if rng.random() < 0.2:
        x = np.asarray(cv2.GaussianBlur(x, (0, 0), rng.uniform(0.4, 1.2)), x.dtype)
    if rng.random() < 0.3:
        x = x + rng.normal(0, rng.uniform(0.005, 0.04), x.shape).astype(np.float32)
    return (np.clip(x, 0, 1) * 255).astype(np.uint8)


def in_colours_of(photograph: Image, image: Image) -> Image:
    """The image with the photograph's mean and standard deviation of each channel of CIELAB.

    (Reinhard et al., "Color transfer between images", 2001.)
    """
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(np.float32)
    other = cv2.cvtColor(photograph[::4, ::4], cv2.COLOR_RGB2LAB).astype(np.float32)
    scale = other.std(axis=(0, 1)) / np.maximum(lab.std(axis=(0, 1)), 1)
    moved = (lab - lab.mean(axis=(0, 1))) * np.clip(scale, 0.5, 2) + other.mean(axis=(0, 1))
    moved = np.clip(moved, 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(moved, cv2.COLOR_LAB2RGB), np.uint8)


def sample_of(frame: Frame) -> dict[str, torch.Tensor] | None:
    """A frame at the training size as a sample; None if too little is known, or it is all flat."""
    known, metres = frame.depth > 0, frame.depth.astype(np.float32) / 1000
    solid = metres[known & (frame.depth < SKY)]
    if known.mean() < LEAST_KNOWN or len(solid) < 100 or np.ptp(solid) < 0.1:
        return None
    return {
        "image": torch.from_numpy(frame.image.transpose(2, 0, 1).copy()),
        "depth": torch.from_numpy(normalise(metres))[None],
        "range": torch.tensor(depth_range(metres)),
        "known": torch.from_numpy(known)[None],
    }


def image_to_model(image: torch.Tensor) -> torch.Tensor:
    """uint8 RGB to float32 in [-1, 1]."""
    return image.float() / 127.5 - 1
