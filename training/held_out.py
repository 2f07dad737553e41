"""Held-out frames at the training size, by kind."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from training.data import WIDTH, Frame, read_nyu_frame, read_split
from training.rgbd import KINDS, held_out_pairs, read_pair

# of NYUv2's frames, the paper's 608x448 crop is seen
NYU_WINDOW = slice(16, 464), slice(16, 624)


@dataclass(frozen=True)
class Truth:
    """image: uint8 [3, height, width], 320 wide. depth: [m] [1, height, width], 0 = unknown."""

    image: Tensor
    depth: Tensor


def truth_of(frame: Frame) -> Truth:
    """A frame at the training width, its height to the next multiple of 8."""
    height = ceil(frame.depth.shape[0] * WIDTH / frame.depth.shape[1] / 8) * 8
    image = cv2.resize(frame.image, (WIDTH, height), interpolation=cv2.INTER_AREA)
    depth = cv2.resize(frame.depth, (WIDTH, height), interpolation=cv2.INTER_NEAREST)
    metres = np.asarray(depth, np.float32) / 1000
    return Truth(torch.from_numpy(image.transpose(2, 0, 1).copy()), torch.from_numpy(metres)[None])


def held_out(
    split: str, nyuv2: Path | None, rgbd: Path | None = None, *, every: int = 1
) -> dict[str, Sequence[Truth]]:
    """Frames of "tune" or "report" by kind, of the folders that are given.

    every: takes one of so many.
    """
    frames: dict[str, Sequence[Truth]] = {}
    if nyuv2:
        whole = [read_nyu_frame(nyuv2, index) for index in read_split(split)[::every]]
        cut = [Frame(frame.image[NYU_WINDOW], frame.depth[NYU_WINDOW]) for frame in whole]
        frames["rooms"] = [truth_of(frame) for frame in cut]
    if rgbd:
        for kind in KINDS:
            names = held_out_pairs(split, kind)[::every]
            frames[kind] = [truth_of(read_pair(rgbd, name)) for name in names]
    return frames
