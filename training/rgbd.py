"""RGB-D pairs of many kinds beside NYUv2's: what trains, what is held out, how often each is drawn.

A folder of sources: `SOURCE/NNNN.jpg`, `SOURCE/NNNN.png` (uint16 mm, 0 = no measurement) and
`index.csv` with their scenes.
"""

import csv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from training.data import SPLITS, Frame, read_frame

# held-out pairs by what they show; "rooms" are NYUv2's own splits
KINDS = ("streets", "indoors", "close-ups")
# frames of a scene that may be an NYUv2 frame that others hold out: drawn never
UNCERTAIN = "slambook2"


@dataclass(frozen=True)
class Pair:
    """One pair: its name, "SOURCE/NNNN", and its scene."""

    name: str
    scene: str


def read_index(folder: Path) -> list[Pair]:
    """Every pair of the folder."""
    with (folder / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [Pair(f"{row['source']}/{row['id']}", f"{row['source']}/{row['scene']}") for row in rows]


def held_out_pairs(split: str, kind: str) -> list[str]:
    """Names of the pairs of "tune" or "report" that show a kind of scene."""
    lines = (SPLITS / f"rgbd_{split}.txt").read_text().splitlines()
    return [line.split()[0] for line in lines if line.endswith(f" {kind}")]


def training_pairs(folder: Path) -> list[Pair]:
    """All pairs of scenes of which none is held out."""
    pairs = read_index(folder)
    held_out = {
        name
        for split in ("tune", "report")
        for kind in KINDS
        for name in held_out_pairs(split, kind)
    }
    scenes = {pair.scene for pair in pairs if pair.name in held_out}
    return [p for p in pairs if p.scene not in scenes and not p.scene.endswith(UNCERTAIN)]


def chances(pairs: list[Pair]) -> npt.NDArray[np.float64]:
    """How often each pair is drawn: a scene as the square root of its number of frames."""
    counts = Counter(pair.scene for pair in pairs)
    weights = np.array([counts[pair.scene] ** -0.5 for pair in pairs])
    return np.asarray(weights / weights.sum())


def read_pair(folder: Path, name: str) -> Frame:
    """One pair."""
    return read_frame(folder / f"{name}.jpg", folder / f"{name}.png")
