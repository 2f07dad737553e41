"""Things that hang on walls, in the wall's frame: x along it, y into the room."""

import numpy as np

from rooms import materials as made_of
from rooms.clutter import clutter
from rooms.materials import Generator
from rooms.mesh import box, lathe, panel, rods, sheet
from rooms.models import Part, Shelf, between, chance


def on_wall(g: Generator, x: float, width: float) -> list[Part]:
    """Something that hangs with its centre at x and is no wider than `width` [m]."""
    hangings = (_picture, _gallery, _mirror, _clock, _shelf, _whiteboard, _cloth, _switch, _sconce)
    weights = np.array([0.3, 0.12, 0.12, 0.06, 0.14, 0.06, 0.08, 0.06, 0.06])
    return hangings[g.choice(len(hangings), p=weights / weights.sum())](g, x, width)


def _framed(
    g: Generator, x: float, z: float, w: float, h: float, inner: made_of.Material
) -> list[Part]:
    border = between(g, 0.0, 0.06)
    t = between(g, 0.008, 0.03)
    frame = box(
        [x - w / 2 - border, 0, z - h / 2 - border], [x + w / 2 + border, t, z + h / 2 + border]
    )
    pane = panel([x - w / 2, t + 0.002, z - h / 2], [x + w / 2, t + 0.002, z + h / 2])
    return [(frame, made_of.wood(g)), (pane, inner)]


def _picture(g: Generator, x: float, width: float) -> list[Part]:
    w, h = between(g, 0.2, min(1.3, width)), between(g, 0.2, 0.9)
    return _framed(g, x, between(g, 1.3, 1.8), w, h, made_of.picture(g))


def _gallery(g: Generator, x: float, width: float) -> list[Part]:
    """Many small pictures in rows."""
    w, h = between(g, 0.12, 0.3), between(g, 0.12, 0.3)
    columns, rows = max(1, int(width / (w + 0.1))), int(g.integers(1, 4))
    parts: list[Part] = []
    for i in range(columns):
        for j in range(rows):
            at = x + (i - (columns - 1) / 2) * (w + 0.1)
            parts += _framed(g, at, 1.25 + j * (h + 0.1), w * 0.9, h * 0.9, made_of.picture(g))
    return parts


def _mirror(g: Generator, x: float, width: float) -> list[Part]:
    w, h = between(g, 0.3, min(1.3, width)), between(g, 0.4, 1.2)
    return _framed(g, x, between(g, 1.2, 1.5), w, h, made_of.mirror(g))


def _clock(g: Generator, x: float, width: float) -> list[Part]:
    del width
    r = between(g, 0.1, 0.2)
    face = lathe([(0, 0.03), (0.9 * r, 0.03), (r, 0)], 24)
    upright = face.turned(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
    return [(upright.shifted([x, 0, between(g, 1.6, 2.0)]), made_of.plastic(g))]


def _shelf(g: Generator, x: float, width: float) -> list[Part]:
    """Boards with things on them."""
    w, d = between(g, 0.3, min(1.4, width)), between(g, 0.15, 0.3)
    material = made_of.wood(g)
    parts: list[Part] = []
    for z in np.linspace(1.2, 1.9, int(g.integers(1, 4))):
        parts.append((box([x - w / 2, 0, z], [x + w / 2, d, z + 0.025]), material))
        parts += clutter(g, Shelf(x - w / 2, 0.01, x + w / 2, d, z + 0.025, 0.3), 6.0)
    return parts


def _whiteboard(g: Generator, x: float, width: float) -> list[Part]:
    w, h = between(g, 0.6, min(2.4, max(0.7, width))), between(g, 0.7, 1.2)
    return _framed(g, x, 1.5, w, h, made_of.ceramic(g) if chance(g, 0.6) else made_of.picture(g))


def _cloth(g: Generator, x: float, width: float) -> list[Part]:
    """A towel, coat or wall hanging."""
    w, h, top = between(g, 0.25, min(1.0, width)), between(g, 0.4, 1.2), between(g, 1.2, 1.9)
    along = np.linspace(-w / 2, w / 2, 24)
    down = np.linspace(0, h, 8)[:, None]
    depth = 0.05 + 0.035 * np.sin(between(g, 10, 40) * along) * (0.3 + down)
    cloth = sheet(np.stack([x + along + 0 * down, depth, top - down + 0 * along], axis=-1))
    bar = rods(np.array([[x - w / 2, 0.05, top]]), np.array([[x + w / 2, 0.05, top]]), 0.01)
    return [(cloth, made_of.fabric(g)), (bar, made_of.metal(g))]


def _switch(g: Generator, x: float, width: float) -> list[Part]:
    del width
    z = float(g.choice([0.3, 1.1]))
    return [(box([x - 0.04, 0, z], [x + 0.04, 0.012, z + 0.08]), made_of.plastic(g))]


def _sconce(g: Generator, x: float, width: float) -> list[Part]:
    """A small wall lamp."""
    del width
    warm = np.array([1.0, 0.8, 0.5], dtype=np.float32)
    lit = made_of.emitter(warm, between(g, 1.0, 5.0)) if chance(g, 0.5) else made_of.plastic(g)
    shade = lathe([(0.06, 0), (0.1, 0.16)], 16)
    return [(shade.shifted([x, 0.11, between(g, 1.5, 1.9)]), lit)]
