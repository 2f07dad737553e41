"""Drawn textures, the same in every process.

Many have strong albedo edges where the depth has none.
"""

from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Float32

SIDE = 256  # [texel]
BANK_SEED = 20260

Texture = Float32[np.ndarray, "side side 3"]
Colour = Float32[np.ndarray, "3"]


def fractal_noise(
    generator: np.random.Generator, *, slope: float, stretch: float = 1.0
) -> Float32[np.ndarray, "side side"]:
    """Periodic noise in 0..1 with amplitude ~ frequency**-slope; `stretch` > 1 draws it along x."""
    fy = np.fft.fftfreq(SIDE)[:, None] * SIDE
    fx = np.fft.rfftfreq(SIDE)[None, :] * SIDE * stretch
    amplitude = (1.0 + fx**2 + fy**2) ** (-slope / 2)
    phase = np.fft.rfft2(generator.standard_normal((SIDE, SIDE)))
    noise = np.fft.irfft2(phase * amplitude, s=(SIDE, SIDE))
    low, high = np.quantile(noise, [0.01, 0.99])
    return np.asarray(np.clip((noise - low) / (high - low), 0, 1), dtype=np.float32)


def random_colour(
    generator: np.random.Generator, *, value: tuple[float, float], saturation: float
) -> Colour:
    """A linear RGB reflectance: any hue, brightness within `value`, saturation up to the bound."""
    hue = generator.random()
    s = saturation * generator.random() ** 1.5  # most things are rather grey
    v = generator.uniform(*value)
    k = (np.array([5.0, 3.0, 1.0]) + hue * 6.0) % 6.0
    return np.asarray(v - v * s * np.clip(np.minimum(k, 4.0 - k), 0, 1), dtype=np.float32)


def _palette(generator: np.random.Generator, count: int) -> Float32[np.ndarray, "count 3"]:
    return np.stack(
        [random_colour(generator, value=(0.05, 0.9), saturation=0.85) for _ in range(count)]
    )


def _grey(values: Float32[np.ndarray, "side side"]) -> Texture:
    return np.repeat(values[..., None], 3, axis=2).astype(np.float32)


def _plaster(generator: np.random.Generator) -> Texture:
    noise = fractal_noise(generator, slope=generator.uniform(0.6, 2.0))
    return _grey(1.0 - generator.uniform(0.01, 0.1) * noise)


def _wood(generator: np.random.Generator) -> Texture:
    grain = fractal_noise(generator, slope=1.3, stretch=generator.uniform(8, 20))
    rings = 0.5 + 0.5 * np.sin(generator.uniform(10, 40) * grain)
    tone = 0.6 * grain + 0.4 * rings
    return _grey(1.0 - generator.uniform(0.15, 0.55) * tone)


def _planks(generator: np.random.Generator) -> Texture:
    image = _wood(generator)
    rows = int(generator.integers(3, 9))
    edges = np.linspace(0, SIDE, rows + 1).astype(int)
    for top, bottom in pairwise(edges):
        shift, joint = generator.integers(0, SIDE, 2)
        image[top:bottom] = np.roll(image[top:bottom], shift, axis=1)
        image[top:bottom] *= generator.uniform(0.75, 1.0)
        image[top : top + 1] *= 0.5
        image[top:bottom, joint : joint + 1] *= 0.5
    return image


def _tiles(generator: np.random.Generator) -> Texture:
    count = int(generator.integers(1, 5))
    colours = _palette(generator, 2) * 0.3 + 0.65
    y, x = np.mgrid[0:SIDE, 0:SIDE] * (count / SIDE)
    checker = (np.floor(x) + np.floor(y)) % 2 if generator.random() < 0.4 else np.zeros_like(x)
    image = colours[checker.astype(int)] * (0.85 + 0.15 * _plaster(generator))
    width = generator.uniform(0.01, 0.04)
    grout = (x % 1 < width) | (y % 1 < width)
    image[grout] = generator.uniform(0.25, 0.9)
    return np.asarray(image, dtype=np.float32)


def _bricks(generator: np.random.Generator) -> Texture:
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    rows, columns = 8, 4
    row = np.floor(y * rows).astype(int)
    u = x * columns + 0.5 * (row % 2)
    tone = generator.uniform(0.6, 1.0, (rows, columns + 1))[row, np.floor(u).astype(int)]
    image = _grey((tone * (0.8 + 0.2 * fractal_noise(generator, slope=0.7))).astype(np.float32))
    mortar = (y * rows % 1 < 0.12) | (u % 1 < 0.06)
    image[mortar] = generator.uniform(0.4, 1.0)
    return image


def _weave(generator: np.random.Generator) -> Texture:
    fine = fractal_noise(generator, slope=0.1)
    coarse = fractal_noise(generator, slope=1.5)
    return _grey(1.0 - generator.uniform(0.1, 0.4) * fine - 0.15 * coarse)


def _stripes(generator: np.random.Generator) -> Texture:
    """Stripes, or with a second direction a plaid."""
    colours = _palette(generator, 5)
    cuts = np.sort(generator.integers(0, SIDE, 8))
    bands = colours[np.searchsorted(cuts, np.arange(SIDE)) % 5]
    image = np.broadcast_to(bands[None], (SIDE, SIDE, 3)).copy()
    if generator.random() < 0.5:
        image = 0.5 * (image + image.transpose(1, 0, 2))
    return image * (1.0 - 0.2 * _grey(fractal_noise(generator, slope=0.3)))


def _print(generator: np.random.Generator) -> Texture:
    """Motifs repeated on a ground: wallpapers, curtains, bedspreads."""
    ground, *inks = _palette(generator, 4)
    count = int(generator.integers(2, 6))
    cell = SIDE // count
    tile = np.tile(ground, (cell, cell, 1)).astype(np.float32)
    for ink in inks:
        centre = tuple(int(v) for v in generator.integers(0, cell, 2))
        axes = tuple(int(v) for v in generator.integers(cell // 12 + 1, cell // 3 + 2, 2))
        angle = generator.uniform(0, 180)
        cv2.ellipse(tile, centre, axes, angle, 0, 360, ink.tolist(), -1, cv2.LINE_AA)
    tile = 0.5 * (tile + tile[:, ::-1]) if generator.random() < 0.5 else tile
    repeated = np.tile(tile, (count + 1, count + 1, 1))
    return np.ascontiguousarray(repeated[:SIDE, :SIDE])


def _blotches(generator: np.random.Generator) -> Texture:
    """Noise cut into a few flat colours: marble, camouflage, stained rugs."""
    noise = fractal_noise(generator, slope=generator.uniform(1.2, 2.2))
    cuts = np.sort(generator.random(3)).astype(np.float32)
    colours = _palette(generator, 4)
    return colours[np.searchsorted(cuts, noise.ravel())].reshape(SIDE, SIDE, 3)


def _carpet(generator: np.random.Generator) -> Texture:
    """Nested borders around a four-fold symmetric field."""
    colours = _palette(generator, 6)
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    inset = np.minimum.reduce([x, y, SIDE - 1 - x, SIDE - 1 - y])
    field = _blotches(generator)
    field = 0.25 * (field + field[::-1] + field[:, ::-1] + field[::-1, ::-1])
    cuts = np.sort(generator.integers(4, 60, 4))
    border = colours[np.searchsorted(cuts, inset.ravel())].reshape(SIDE, SIDE, 3)
    image = np.where((inset < cuts[-1])[..., None], border, field)
    return np.asarray(image * _weave(generator), dtype=np.float32)


def _art(generator: np.random.Generator) -> Texture:
    """Paintings, posters, photographs: a smooth ground with random shapes on it."""
    first, second, *inks = _palette(generator, 9)
    ramp = fractal_noise(generator, slope=generator.uniform(1.5, 3.0))[..., None]
    image = np.ascontiguousarray(first * ramp + second * (1 - ramp), dtype=np.float32)
    for ink in inks[: int(generator.integers(2, 8))]:
        points = generator.integers(0, SIDE, (int(generator.integers(3, 7)), 2)).astype(np.int32)
        if generator.random() < 0.5:
            cv2.fillPoly(image, [points], ink.tolist(), cv2.LINE_AA)
        else:
            axes = tuple(int(v) for v in generator.integers(5, 90, 2))
            centre = tuple(int(v) for v in points[0])
            cv2.ellipse(image, centre, axes, 0, 0, 360, ink.tolist(), -1, cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), generator.uniform(0.3, 3.0))


def _page(generator: np.random.Generator) -> Texture:
    """Lines of print with a few blocks: book covers, papers, screens, labels."""
    ground, ink, *blocks = _palette(generator, 5)
    image = np.tile(ground, (SIDE, SIDE, 1)).astype(np.float32)
    pitch = int(generator.integers(8, 24))
    for top in range(pitch, SIDE - pitch, pitch):
        left = 16
        while left < SIDE - 30 and generator.random() < 0.93:
            word = int(generator.integers(6, 36))
            image[top : top + pitch // 2, left : left + word] = ink
            left += word + 6
    for block in blocks:
        x, y, w, h = generator.integers(20, SIDE // 2, 4)
        if generator.random() < 0.6:
            image[y : y + h, x : x + w] = block
    return image


def _outdoors(generator: np.random.Generator) -> Texture:
    """What a window shows: bright sky above buildings and trees."""
    rows = np.linspace(0, 1, SIDE, dtype=np.float32)[:, None, None]
    sky = np.array([0.55, 0.75, 1.0]) * (1 - rows) + np.array([0.95, 0.97, 1.0]) * rows
    image = np.broadcast_to(sky, (SIDE, SIDE, 3)).astype(np.float32).copy()
    for _ in range(int(generator.integers(2, 7))):
        x, y = generator.integers(0, SIDE, 2)
        w = int(generator.integers(20, 120))
        colour = random_colour(generator, value=(0.2, 0.7), saturation=0.3)
        image[max(SIDE // 3, y) :, x : x + w] = colour
        image[max(SIDE // 3, y) + 8 :: 16, x + 4 : x + w : 12] = colour * 0.5
    leaves = fractal_noise(generator, slope=1.4)
    ridge = SIDE * generator.uniform(0.4, 0.9) - 60 * fractal_noise(generator, slope=2.5)[0]
    trees = np.arange(SIDE)[:, None] > ridge[None, :]
    green = np.array([0.16, 0.24, 0.1], dtype=np.float32) * (0.3 + 1.2 * leaves[..., None])
    image[trees] = green[trees]
    return image


def _sky(generator: np.random.Generator) -> Texture:
    """Blue or grey, paler towards the horizon (its middle row), with or without clouds."""
    rows = np.abs(np.linspace(1, -1, SIDE, dtype=np.float32))[:, None, None]
    zenith = np.array([0.25, 0.45, 0.95]) * generator.uniform(0.5, 1.0)
    if generator.random() < 0.4:
        zenith = np.full(3, generator.uniform(0.5, 0.95))
    horizon = np.array([0.85, 0.92, 1.0]) * generator.uniform(0.8, 1.0)
    clouds = fractal_noise(generator, slope=1.8, stretch=0.5)[..., None]
    cover = np.clip((clouds - generator.uniform(0.2, 1.1)) * 3, 0, 1)
    clear = zenith * rows + horizon * (1 - rows)
    return np.asarray(clear * (1 - cover) + cover * generator.uniform(0.7, 1.0), np.float32)


DRAWERS: dict[str, tuple[int, Callable[[np.random.Generator], Texture]]] = {
    "plaster": (8, _plaster),
    "wood": (12, _wood),
    "planks": (8, _planks),
    "tiles": (12, _tiles),
    "bricks": (4, _bricks),
    "weave": (8, _weave),
    "stripes": (12, _stripes),
    "print": (18, _print),
    "blotches": (10, _blotches),
    "carpet": (14, _carpet),
    "art": (32, _art),
    "page": (24, _page),
    "outdoors": (10, _outdoors),
    "sky": (12, _sky),
}
