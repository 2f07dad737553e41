"""Square crops of training photographs, as textures for rendered surfaces.

Nothing of them is published: they are written to a file that `python -m rooms --crops` reads.
"""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from rooms.textures import SIDE
from training.data import NYU_BORDER, Frame, read_nyu_frame, training_indices
from training.rgbd import read_pair, training_pairs

Texture = npt.NDArray[np.uint8]
# how many of each kind
COUNTS = {"plain": 300, "pattern": 400, "picture": 300}
# standard deviation of the logarithm of brightness: a plain wall, and what is patterned
PLAIN, PATTERNED = 0.05, 0.12
# greatest standard deviation of inverse depth about a plane, relative
FLATNESS = 0.012


def cut_crops(nyuv2: Path, rgbd: Path | None, seed: int = 0) -> dict[str, Texture]:
    """Textures uint8 [n, SIDE, SIDE, 3] of linear reflectance by kind.

    plain and pattern: of flat surfaces, in the light of their surroundings evened out, of mean
    brightness .8. picture: of anything. All repeat without a seam.
    """
    rng = np.random.default_rng(seed)
    frames = [read_nyu_frame(nyuv2, index) for index in training_indices(nyuv2)]
    if rgbd:
        frames += [read_pair(rgbd, pair.name) for pair in training_pairs(rgbd)]
    found: dict[str, list[Texture]] = {kind: [] for kind in COUNTS}
    for crop, flat in _squares(frames, rng):
        light = crop.astype(np.float32).mean(axis=2) / 255
        contrast = float(np.log(np.maximum(light, 0.02)).std())
        kind = "plain" if contrast < PLAIN else "pattern" if flat else "picture"
        if (kind != "picture" and not flat) or (kind == "pattern" and contrast < PATTERNED):
            continue
        if len(found[kind]) < COUNTS[kind]:
            found[kind].append(_texture(crop, even=kind != "picture"))
        if all(len(items) == COUNTS[name] for name, items in found.items()):
            break
    return {kind: np.stack(items) for kind, items in found.items()}


def write_crops(path: Path, nyuv2: Path, rgbd: Path | None) -> None:
    """Cuts crops and writes them as one file."""
    crops = cut_crops(nyuv2, rgbd)
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **crops)


def _squares(frames: list[Frame], rng: np.random.Generator) -> Iterator[tuple[Texture, bool]]:
    """Random squares of the frames, endlessly, and whether each shows one flat surface."""
    while True:
        frame = frames[rng.integers(len(frames))]
        height, width = frame.depth.shape
        side = int(rng.integers(48, 161)) * width // 640
        y = int(rng.integers(NYU_BORDER, height - side - NYU_BORDER))
        x = int(rng.integers(NYU_BORDER, width - side - NYU_BORDER))
        window = slice(y, y + side), slice(x, x + side)
        yield frame.image[window], _is_flat(frame.depth[window])


def _is_flat(depth: npt.NDArray[np.uint16]) -> bool:
    """Whether inverse depth is linear in the pixel, as it is on a plane."""
    if (depth == 0).mean() > 0.05:
        return False
    y, x = np.nonzero(depth)
    inverse = 1 / depth[y, x].astype(np.float64)
    basis = np.stack([np.ones(len(x)), x, y], axis=1)
    solution = np.linalg.lstsq(basis, inverse, rcond=None)[0]
    return bool((inverse - basis @ solution).std() < FLATNESS * inverse.mean())


def _texture(crop: Texture, *, even: bool) -> Texture:
    """A crop as linear reflectance, mirrored to both sides so that it repeats without a seam."""
    half = cv2.resize(crop, (SIDE // 2, SIDE // 2), interpolation=cv2.INTER_AREA)
    linear = (half.astype(np.float32) / 255) ** 2.2
    if even:
        light = cv2.GaussianBlur(linear.mean(axis=2), (0, 0), SIDE / 8)
        linear = 0.8 * linear / np.maximum(light, 0.01)[..., None]
    across = np.concatenate([linear, linear[:, ::-1]], axis=1)
    both = np.concatenate([across, across[::-1]], axis=0)
    return np.asarray(np.clip(both, 0, 1) * 255, np.uint8)
