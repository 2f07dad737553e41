"""Cupboards and shelves: each function draws one Model at random."""

import numpy as np

from rooms import materials as made_of
from rooms.materials import Generator
from rooms.mesh import box, boxes, panel, rods
from rooms.models import Model, Part, Shelf, between, chance


def drawers(
    g: Generator, w: float, d: float, h: float, *, rows: int, body: made_of.Material
) -> Model:
    """A block with drawer fronts and handles."""
    front = body if chance(g, 0.6) else made_of.plastic(g)
    edges = np.linspace(0.04, h - 0.02, rows + 1)
    low = np.stack([np.full(rows, -w / 2 + 0.01), np.full(rows, d), edges[:-1] + 0.006], axis=1)
    high = np.stack(
        [np.full(rows, w / 2 - 0.01), np.full(rows, d + 0.018), edges[1:] - 0.006], axis=1
    )
    centre = (low + high) / 2
    reach = min(0.08, w / 4)
    handles = rods(
        centre + np.array([-reach, 0.03, 0.0]),
        centre + np.array([reach, 0.03, 0.0]),
        between(g, 0.004, 0.01),
        6,
    )
    parts = (
        (box([-w / 2, 0, 0], [w / 2, d, h]), body),
        (boxes(low, high), front),
        (handles, made_of.metal(g)),
    )
    return Model(parts, (w, d + 0.04, h), (Shelf(-w / 2, 0, w / 2, d, h, 0.5),))


def dresser(g: Generator) -> Model:
    """A low chest of drawers, or a night table."""
    w, d, h = between(g, 0.4, 1.6), between(g, 0.35, 0.55), between(g, 0.45, 1.2)
    return drawers(g, w, d, h, rows=int(g.integers(2, 5)), body=made_of.wood(g))


def wardrobe(g: Generator) -> Model:
    """Tall, with doors; some have dark gloss or mirror fronts."""
    w, d, h = between(g, 0.6, 2.2), between(g, 0.5, 0.65), between(g, 1.6, 2.3)
    body = made_of.wood(g) if chance(g, 0.7) else made_of.plastic(g)
    front = body
    if chance(g, 0.3):
        front = made_of.dark_gloss(g) if chance(g, 0.6) else made_of.mirror(g)
    n = max(1, round(w / 0.55))
    edges = np.linspace(-w / 2, w / 2, n + 1)
    low = np.stack([edges[:-1] + 0.005, np.full(n, d), np.full(n, 0.06)], axis=1)
    high = np.stack([edges[1:] - 0.005, np.full(n, d + 0.02), np.full(n, h - 0.02)], axis=1)
    knobs = np.stack([edges[1:] - 0.06, np.full(n, d + 0.05), np.full(n, h / 2)], axis=1)
    parts = (
        (box([-w / 2, 0, 0], [w / 2, d, h]), body),
        (boxes(low, high), front),
        (
            rods(knobs - np.array([0, 0, 0.1]), knobs + np.array([0, 0, 0.1]), 0.008, 6),
            made_of.metal(g),
        ),
    )
    return Model(parts, (w, d + 0.05, h), (Shelf(-w / 2, 0, w / 2, d, h, 0.3),))


def bookshelf(g: Generator) -> Model:
    """Open shelves filled with books."""
    w, d, h = between(g, 0.5, 2.0), between(g, 0.22, 0.4), between(g, 0.7, 2.2)
    t = between(g, 0.015, 0.035)
    rows = max(2, round(h / between(g, 0.28, 0.42)))
    levels = np.linspace(0.06, h - t, rows + 1)
    low = [[-w / 2, 0, z] for z in levels] + [[-w / 2, 0, 0], [w / 2 - t, 0, 0], [-w / 2, 0, 0]]
    high = [[w / 2, d, z + t] for z in levels] + [
        [-w / 2 + t, d, h],
        [w / 2, d, h],
        [w / 2, 0.01, h],
    ]
    body = made_of.wood(g)
    parts: list[Part] = [(boxes(np.array(low), np.array(high)), body)]
    shelves = [Shelf(-w / 2, 0, w / 2, d, h, 0.4)]
    for bottom, top in zip(levels[:-1] + t, levels[1:], strict=True):
        free = Shelf(-w / 2 + t, 0.02, w / 2 - t, d, bottom, top - bottom)
        if chance(g, 0.7):
            parts += books(g, free)
        else:
            shelves.append(free)
    return Model(tuple(parts), (w, d, h), tuple(shelves))


def books(g: Generator, shelf: Shelf) -> list[Part]:
    """A row of upright books in a few cover materials, with gaps."""
    width = shelf.x1 - shelf.x0
    thickness = g.uniform(0.012, 0.05, int(width / 0.02))
    right = np.cumsum(thickness)
    keep = (right < width * between(g, 0.4, 1.0)) & (g.random(len(right)) < 0.95)
    thickness, right = thickness[keep], right[keep]
    if len(right) == 0:
        return []
    depth = np.minimum(g.uniform(0.6, 0.95, len(right)), 1.0) * (shelf.y1 - shelf.y0)
    height = np.minimum(shelf.clearance * 0.92, g.uniform(0.16, 0.3, len(right)))
    x = shelf.x0 + right
    low = np.stack([x - thickness, np.full_like(x, shelf.y0), np.full_like(x, shelf.z)], axis=1)
    high = np.stack([x - 0.001, shelf.y0 + depth, shelf.z + height], axis=1)
    covers = g.integers(0, 5, len(x))
    rows = [(low[covers == c], high[covers == c]) for c in range(5)]
    return [(boxes(a, b), made_of.printed(g)) for a, b in rows if len(a)]


def kitchen(g: Generator) -> Model:
    """A counter with cabinets below and, mostly, above."""
    w, d, h = between(g, 1.2, 3.0), 0.6, between(g, 0.85, 0.95)
    body = made_of.wood(g) if chance(g, 0.5) else made_of.plastic(g)
    n = round(w / 0.5)
    edges = np.linspace(-w / 2, w / 2, n + 1)

    def row(y0: float, y1: float, z0: float, z1: float) -> list[Part]:
        low = np.stack([edges[:-1] + 0.004, np.full(n, y1), np.full(n, z0)], axis=1)
        high = np.stack([edges[1:] - 0.004, np.full(n, y1 + 0.02), np.full(n, z1)], axis=1)
        grip = (low + high) / 2 + [0.15, 0.025, 0.0]
        return [
            (box([-w / 2, y0, z0 - 0.01], [w / 2, y1, z1 + 0.01]), body),
            (boxes(low, high), body),
            (
                rods(grip - np.array([0, 0, 0.07]), grip + np.array([0, 0, 0.07]), 0.006, 6),
                made_of.metal(g),
            ),
        ]

    top = made_of.plastic(g) if chance(g, 0.5) else made_of.wood(g)
    parts = row(0, d - 0.04, 0.1, h - 0.06)
    parts.append((box([-w / 2, 0, h - 0.04], [w / 2, d, h]), top))
    if chance(g, 0.75):
        parts += row(0, 0.33, h + between(g, 0.45, 0.6), 2.15)
    if chance(g, 0.6):
        x = between(g, -w / 2 + 0.4, w / 2 - 0.4)
        spout = np.array([[x, 0.1, h], [x, 0.1, h + 0.25]])
        parts.append(
            (
                rods(spout, np.array([[x, 0.1, h + 0.25], [x, 0.28, h + 0.2]]), 0.014),
                made_of.metal(g),
            )
        )
    return Model(tuple(parts), (w, d, 2.15), (Shelf(-w / 2, 0.05, w / 2, d, h, 0.4),))


def appliance(g: Generator) -> Model:
    """A refrigerator, oven, washing machine or printer: a smooth block with a front."""
    w, d = between(g, 0.5, 0.75), between(g, 0.5, 0.68)
    h = float(g.choice([0.85, 0.9, between(g, 1.2, 1.9)]))
    shell = made_of.plastic(g) if chance(g, 0.6) else made_of.metal(g)
    split = between(g, 0.3, 0.75) * h
    low = np.array([[-w / 2, d, 0.04], [-w / 2, d, split + 0.01]])
    high = np.array([[w / 2, d + 0.03, split], [w / 2, d + 0.03, h]])
    parts: list[Part] = [(box([-w / 2, 0, 0], [w / 2, d, h]), shell), (boxes(low, high), shell)]
    grip = np.array(
        [[w / 2 - 0.06, d + 0.06, 0.55 * split], [w / 2 - 0.06, d + 0.06, split + 0.05]]
    )
    parts.append((rods(grip, grip + np.array([[0, 0, 0.25 * split]] * 2), 0.012), made_of.metal(g)))
    if h < 1.0:  # the dark pane of an oven or a drum
        pane = panel([-w / 3, d + 0.032, 0.2], [w / 3, d + 0.032, split - 0.08])
        parts.append((pane, made_of.dark_gloss(g)))
    return Model(tuple(parts), (w, d + 0.07, h), (Shelf(-w / 2, 0, w / 2, d, h, 0.4),))


def rack(g: Generator) -> Model:
    """An open rack of thin posts and boards, for a store room or a shop."""
    w, d, h = between(g, 0.8, 2.4), between(g, 0.3, 0.6), between(g, 1.2, 2.3)
    levels = np.linspace(0.1, h, int(g.integers(3, 7)))
    steel = made_of.metal(g)
    n = len(levels)
    low = np.stack([np.full(n, -w / 2), np.zeros(n), levels - 0.02], axis=1)
    high = np.stack([np.full(n, w / 2), np.full(n, d), levels], axis=1)
    feet = np.array([[-w / 2, 0, 0], [w / 2, 0, 0], [-w / 2, d, 0], [w / 2, d, 0]])
    parts: list[Part] = [
        (boxes(low, high), made_of.wood(g) if chance(g, 0.5) else steel),
        (rods(feet, feet + np.array([[0, 0, h]]), 0.014), steel),
    ]
    gap = float(levels[1] - levels[0]) - 0.03
    shelves = tuple(Shelf(-w / 2, 0.02, w / 2, d, float(z), gap) for z in levels)
    return Model(tuple(parts), (w, d, h), shelves)
