"""The bank of textures with mipmaps: every surface takes its albedo from one of its layers.

Materials tint and scale it. `use_crops` puts crops of photographs in the place of many layers.
"""

from collections.abc import Mapping
from functools import cache

import numpy as np
from jaxtyping import Float32, Int, UInt8

from rooms.textures import BANK_SEED, DRAWERS, SIDE

_LEVELS = 7  # 256, 128, ... 4 texels
# which crops may stand for which layers
_CROPS = {
    "plain": ("plaster",),
    "pattern": ("wood", "weave", "carpet", "stripes", "blotches"),
    "picture": ("print", "art", "page"),
}
_CROP_SHARE = 0.7
# what `use_crops` chose, by layer
_replaced: dict[int, UInt8[np.ndarray, "side side 3"]] = {}


def use_crops(crops: Mapping[str, UInt8[np.ndarray, "n side side 3"]], seed: int) -> None:
    """From now on in this process most layers are random crops of their kind, chosen by the seed.

    crops: linear reflectance, by "plain", "pattern" and "picture"; none gives the drawn layers.
    """
    generator = np.random.default_rng([BANK_SEED, seed])
    _replaced.clear()
    for name, images in crops.items():
        for layer in (layer for kind in _CROPS[name] for layer in layers(kind)):
            if generator.random() < _CROP_SHARE:
                _replaced[layer] = images[generator.integers(len(images))]
    _bank.cache_clear()


def layers(kind: str) -> range:
    """Indices of the layers of one kind."""
    first = 0
    for name, (count, _) in DRAWERS.items():
        if name == kind:
            return range(first, first + count)
        first += count
    raise KeyError(kind)


@cache
def _bank() -> tuple[UInt8[np.ndarray, "texels 3"], Int[np.ndarray, " levels"]]:
    """All texels of all levels in one table, and the first row of each level."""
    drawn = []
    for kind, (count, draw) in DRAWERS.items():
        for index in range(count):
            name = int.from_bytes(kind.encode()[:4], "big")
            drawn.append(draw(np.random.default_rng([BANK_SEED, name, index])))
    for layer, crop in _replaced.items():
        drawn[layer] = crop.astype(np.float32) / 255
    stack = np.clip(np.stack(drawn), 0, 1)
    tables = []
    for _ in range(_LEVELS):
        tables.append((stack * 255 + 0.5).astype(np.uint8).reshape(-1, 3))
        rows = stack[:, ::2] + stack[:, 1::2]
        stack = 0.25 * (rows[:, :, ::2] + rows[:, :, 1::2])
    starts = np.cumsum([0] + [len(table) for table in tables[:-1]])
    return np.concatenate(tables), starts


def mean_albedo(layer: Int[np.ndarray, " n"]) -> Float32[np.ndarray, "n 3"]:
    """The average colour of each layer, in 0..1."""
    texels, starts = _bank()
    coarsest = texels[starts[-1] :].reshape(-1, (SIDE >> (_LEVELS - 1)) ** 2, 3)
    mean: Float32[np.ndarray, "n 3"] = coarsest.mean(axis=1, dtype=np.float32)[layer] / 255
    return mean


def lookup(
    layer: Int[np.ndarray, " n"],
    uv: Float32[np.ndarray, "n 2"],
    footprint: Float32[np.ndarray, " n"],
) -> Float32[np.ndarray, "n 3"]:
    """Albedo in 0..1, bilinear within the mipmap level that suits the footprint.

    uv: texture coordinates, one tile per unit, repeated. footprint: width of a pixel on the
    surface, in tiles.
    """
    texels, starts = _bank()
    level = np.log2(np.maximum(footprint * SIDE, 1.0))
    level = np.minimum((level + 0.5).astype(np.int64), _LEVELS - 1)
    side = SIDE >> level
    base = starts[level] + layer * side * side
    mask = side - 1  # sides are powers of two
    position = uv * side[:, None].astype(np.float32) - 0.5
    corner = np.floor(position)
    weight = (position - corner).astype(np.float32)
    x0 = corner[:, 0].astype(np.int64) & mask
    y0 = corner[:, 1].astype(np.int64) & mask
    x1, y1 = (x0 + 1) & mask, (y0 + 1) & mask
    wx, wy = weight[:, :1], weight[:, 1:]
    upper = texels[base + y0 * side + x0] * (1 - wx) + texels[base + y0 * side + x1] * wx
    lower = texels[base + y1 * side + x0] * (1 - wx) + texels[base + y1 * side + x1] * wx
    blended: Float32[np.ndarray, "n 3"] = (upper * (1 - wy) + lower * wy) * np.float32(1 / 255)
    return blended
