"""The room itself: floor, ceiling, walls with openings, doors, windows, things on walls."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from rooms import materials as made_of
from rooms.materials import Generator, Material
from rooms.mesh import Mesh, box, boxes, join, panel, rods, sheet
from rooms.models import Model, Part, between, chance

THICKNESS = 0.14  # of a wall [m]


@dataclass(frozen=True)
class Opening:
    """A rectangular hole in a wall, from x0 to x1 along it and z0 to z1 in height [m]."""

    x0: float
    x1: float
    z0: float
    z1: float


@dataclass(frozen=True)
class Wall:
    """A vertical wall seen from inside: `origin` is its left foot, it runs along local x.

    yaw [rad] turns local x, y to the world; local +y points into the room.
    """

    origin: tuple[float, float]
    yaw: float
    length: float
    height: float

    def place(self, parts: Sequence[Part]) -> list[Part]:
        """Parts from the wall's frame to the world."""
        return [(m.moved([*self.origin, 0.0], self.yaw), material) for m, material in parts]

    def to_world(self, point: Sequence[float]) -> Float[np.ndarray, "3"]:
        """A point of the wall's frame in the world [m]."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        x, y, z = point
        return np.array([self.origin[0] + c * x - s * y, self.origin[1] + s * x + c * y, z])

    def direction(self, x: float, y: float) -> Float[np.ndarray, "3"]:
        """A horizontal direction of the wall's frame in the world."""
        return np.asarray(self.to_world([x, y, 0.0]) - self.to_world([0.0, 0.0, 0.0]))


def room_walls(width: float, depth: float, height: float) -> list[Wall]:
    """The four walls of the room 0..width by 0..depth."""
    quarter = np.pi / 2
    return [
        Wall((0.0, 0.0), 0.0, width, height),
        Wall((width, 0.0), quarter, depth, height),
        Wall((width, depth), 2 * quarter, width, height),
        Wall((0.0, depth), 3 * quarter, depth, height),
    ]


def wall_mesh(length: float, height: float, openings: Sequence[Opening]) -> Mesh:
    """The wall as boxes around its openings, which do not overlap along x."""
    t = THICKNESS
    low: list[list[float]] = []
    high: list[list[float]] = []

    def piece(x0: float, x1: float, z0: float, z1: float) -> None:
        if x1 - x0 > 1e-4 and z1 - z0 > 1e-4:
            low.append([x0, -t, z0])
            high.append([x1, 0.0, z1])

    left = -t
    for hole in sorted(openings, key=lambda hole: hole.x0):
        piece(left, hole.x0, 0, height)
        piece(hole.x0, hole.x1, 0, hole.z0)
        piece(hole.x0, hole.x1, hole.z1, height)
        left = hole.x1
    piece(left, length + t, 0, height)
    return boxes(np.array(low), np.array(high))


def cladding(
    length: float, openings: Sequence[Opening], height: float, thickness: float
) -> Mesh | None:
    """A skirting board or the painted foot of the wall, interrupted by low openings."""
    low_ones = sorted((o for o in openings if o.z0 < height), key=lambda o: o.x0)
    edges = [0.0, *(e for o in low_ones for e in (o.x0 - 0.1, o.x1 + 0.1)), length]
    spans = np.array(edges).reshape(-1, 2)
    left, right = spans[spans[:, 1] > spans[:, 0]].T
    if len(left) == 0:
        return None
    zero = np.zeros_like(left)
    return boxes(
        np.stack([left, zero, zero], axis=1),
        np.stack([right, zero + thickness, zero + height], axis=1),
    )


def window(g: Generator, hole: Opening, daylight: float) -> list[Part]:
    """Pane, frame with bars, sill; perhaps curtains or a blind."""
    frame = made_of.plastic(g) if chance(g, 0.5) else made_of.wood(g)
    y = -between(g, 0.06, 0.12)
    pane = panel([hole.x0, y, hole.z0], [hole.x1, y, hole.z1])
    parts: list[Part] = [(pane, made_of.window_pane(g, daylight))]
    t = between(g, 0.03, 0.07)
    columns, rows = int(g.integers(1, 4)), int(g.integers(1, 3))
    low, high = [], []
    for x in np.linspace(hole.x0 + t / 2, hole.x1 - t / 2, columns + 1):
        low.append([x - t / 2, y, hole.z0])
        high.append([x + t / 2, y + 0.04, hole.z1])
    for z in np.linspace(hole.z0 + t / 2, hole.z1 - t / 2, rows + 1):
        low.append([hole.x0, y, z - t / 2])
        high.append([hole.x1, y + 0.04, z + t / 2])
    if chance(g, 0.6):
        low.append([hole.x0 - 0.05, y, hole.z0 - 0.03])
        high.append([hole.x1 + 0.05, 0.08, hole.z0])
    parts.append((boxes(np.array(low), np.array(high)), frame))
    draw = g.random()
    if draw < 0.4:
        parts += _curtains(g, hole)
    elif draw < 0.55:
        parts.append((_blind(g, hole), made_of.plastic(g)))
    return parts


def _curtains(g: Generator, hole: Opening) -> list[Part]:
    """Folded cloth on both sides under a rail."""
    cloth = made_of.fabric(g)
    top = hole.z1 + 0.12
    bottom = 0.03 if chance(g, 0.5) else max(0.03, hole.z0 - 0.15)
    closed = between(g, 0.1, 0.5) * (hole.x1 - hole.x0)
    depth, folds = between(g, 0.02, 0.05), between(g, 8, 16)
    parts: list[Part] = []
    for left, right in ((hole.x0 - 0.2, hole.x0 + closed), (hole.x1 - closed, hole.x1 + 0.2)):
        x = np.linspace(left, right, max(12, int((right - left) * folds * 5)))
        z = np.array([top, bottom])[:, None]
        y = 0.07 + depth * np.sin(2 * np.pi * folds * (x - left)) + 0 * z
        parts.append((sheet(np.stack([x + 0 * z, y, z + 0 * x], axis=-1)), cloth))
    rail = rods(
        np.array([[hole.x0 - 0.25, 0.07, top]]), np.array([[hole.x1 + 0.25, 0.07, top]]), 0.012
    )
    return [*parts, (rail, made_of.metal(g))]


def _blind(g: Generator, hole: Opening) -> Mesh:
    """Horizontal slats over the upper part of the window."""
    bottom = hole.z0 + between(g, 0.0, 0.7) * (hole.z1 - hole.z0)
    z = np.arange(bottom, hole.z1, 0.04)
    low = np.stack([np.full_like(z, hole.x0), np.full_like(z, 0.01), z], axis=1)
    return boxes(
        low, low + np.array([hole.x1 - hole.x0, between(g, 0.004, 0.03), between(g, 0.003, 0.03)])
    )


def door(g: Generator, hole: Opening, *, open_: bool) -> list[Part]:
    """Casing and leaf; an open leaf stands into the room."""
    casing = made_of.plastic(g) if chance(g, 0.5) else made_of.wood(g)
    leaf = casing if chance(g, 0.5) else made_of.wood(g)
    b = between(g, 0.05, 0.1)
    low = [[hole.x0 - b, 0, 0], [hole.x1, 0, 0], [hole.x0 - b, 0, hole.z1]]
    high = [
        [hole.x0, 0.02, hole.z1],
        [hole.x1 + b, 0.02, hole.z1],
        [hole.x1 + b, 0.02, hole.z1 + b],
    ]
    parts: list[Part] = [(boxes(np.array(low), np.array(high)), casing)]
    w, h = hole.x1 - hole.x0, hole.z1
    pieces = [([0, -0.04, 0.005], [w, 0, h])]
    rows, columns = int(g.integers(1, 4)), int(g.integers(1, 3))
    if chance(g, 0.7):  # raised panels
        xs, zs = np.linspace(0.08, w - 0.08, columns + 1), np.linspace(0.1, h - 0.1, rows + 1)
        for x0, x1 in pairwise(xs):
            for z0, z1 in pairwise(zs):
                pieces.append(([x0 + 0.03, 0, z0 + 0.03], [x1 - 0.03, 0.012, z1 - 0.03]))
    body = boxes(np.array([p[0] for p in pieces]), np.array([p[1] for p in pieces]))
    handle = join(
        [
            box([w - 0.1, 0, 1.0], [w - 0.06, 0.02, 1.14]),
            box([w - 0.18, 0.03, 1.06], [w - 0.07, 0.05, 1.08]),
        ]
    )
    swing = between(g, 0.9, 1.9) if open_ else 0.0
    place = [hole.x0, -0.01 if open_ else -0.03, 0]
    parts += [(body.moved(place, swing), leaf), (handle.moved(place, swing), made_of.metal(g))]
    return parts


def other_room(g: Generator, hole: Opening, height: float, contents: Sequence[Model]) -> list[Part]:
    """What an open door shows: a second room behind the wall, with models at its far wall."""
    t = THICKNESS
    depth, left, right = between(g, 0.9, 4.5), between(g, 0.3, 2.5), between(g, 0.3, 2.5)
    x0, x1 = hole.x0 - left, hole.x1 + right
    y0, y1 = -t - depth, -t
    wall, ground, top = made_of.paint(g), made_of.floor(g), made_of.ceiling(g)
    side = boxes(
        np.array([[x0 - t, y0, 0], [x1, y0, 0], [x0 - t, y0 - t, 0]]),
        np.array([[x0, y1, height], [x1 + t, y1, height], [x1 + t, y0, height]]),
    )
    parts: list[Part] = [
        (side, wall),
        (box([x0, y0, -t], [x1, -t, 0]), ground),
        (box([x0, y0, height], [x1, -t, height + t]), top),
    ]
    for model in contents:
        w, d, _ = model.size
        if x0 + w < x1 and d < depth - 0.3:
            parts += model.moved([between(g, x0 + w / 2, x1 - w / 2), y0, 0], 0.0)
    return parts


def slab(width: float, depth: float, z0: float, z1: float, material: Material) -> Part:
    """A floor or ceiling under or over the whole room and its walls."""
    t = THICKNESS
    return (box([-t, -t, z0], [width + t, depth + t, z1]), material)
