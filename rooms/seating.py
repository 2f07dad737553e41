"""Chairs, sofas, beds: each function draws one Model at random."""

import numpy as np

from rooms import materials as made_of
from rooms.materials import Generator
from rooms.mesh import Mesh, box, join, pillow, rods, sheet
from rooms.models import Model, Part, Shelf, between, chance
from rooms.tables import legs


def chair(g: Generator) -> Model:
    """A dining chair: legs, seat, a back of slats, a board or a cushion."""
    w, d = between(g, 0.38, 0.5), between(g, 0.4, 0.5)
    h, top = between(g, 0.42, 0.48), between(g, 0.75, 1.05)
    frame = made_of.wood(g) if chance(g, 0.6) else made_of.metal(g)
    seat = made_of.fabric(g) if chance(g, 0.5) else frame
    thin = between(g, 0.02, 0.045)
    parts: list[Part] = [
        (legs(w, d, h, thin, round_=chance(g, 0.5), splay=between(g, 0, 0.15)), frame)
    ]
    if seat is frame:
        parts.append((box([-w / 2, 0, h - 0.02], [w / 2, d, h + 0.01]), frame))
    else:
        parts.append((pillow([w, d, 0.1], square=0.3).shifted([0, d / 2, h]), seat))
    x = w / 2 - thin
    posts = rods(
        np.array([[-x, 0.02, h], [x, 0.02, h]]),
        np.array([[-x, -0.06, top], [x, -0.06, top]]),
        thin / 2,
    )
    parts.append((posts, frame))
    if chance(g, 0.5):
        n = int(g.integers(2, 7))
        if chance(g, 0.5):
            xs = np.linspace(-x, x, n + 2)[1:-1]
            a = np.stack([xs, np.full(n, 0.02), np.full(n, h)], axis=1)
            slats = rods(a, a + np.array([0, -0.08, top - h - 0.03]), 0.009, 6)
        else:
            zs = np.linspace(h + 0.12, top - 0.03, n)
            ys = 0.02 - 0.08 * (zs - h) / (top - h)
            a = np.stack([np.full(n, -x), ys, zs], axis=1)
            slats = rods(a, a * [-1, 1, 1], 0.015, 6)
        parts += [(slats, frame), (box([-x, -0.075, top - 0.06], [x, -0.05, top]), frame)]
    else:
        board = pillow([w * 0.95, 0.06, 0.7 * (top - h)], square=0.3)
        parts.append((board.shifted([0, -0.04, h + 0.62 * (top - h)]), seat))
    return Model(
        tuple((m.shifted([0, 0.08, 0]), material) for m, material in parts), (w, d + 0.08, top)
    )


def office_chair(g: Generator) -> Model:
    """A swivel chair on a star foot."""
    h, top = between(g, 0.42, 0.52), between(g, 0.9, 1.2)
    cloth, frame = made_of.fabric(g), made_of.dark_gloss(g)
    angle = np.arange(5) * 2 * np.pi / 5 + g.random()
    tips = np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), np.full(5, 0.06)], axis=1)
    centre = np.tile([0.0, 0.0, 0.11], (5, 1))
    parts: list[Part] = [
        (rods(centre, tips, 0.025, 6), frame),
        (rods(np.array([[0, 0, 0.08]]), np.array([[0, 0, h]]), 0.025), frame),
        (pillow([0.5, 0.48, 0.12], square=0.4).shifted([0, 0, h]), cloth),
        (
            pillow([0.46, 0.09, top - h - 0.1], square=0.4).shifted(
                [0, -0.22, (top + h) / 2 + 0.05]
            ),
            cloth,
        ),
    ]
    if chance(g, 0.6):
        a = np.array([[-0.28, -0.15, h + 0.2], [0.28, -0.15, h + 0.2]])
        parts.append((rods(a, a + np.array([0, 0.28, 0]), 0.02, 6), frame))
    moved = tuple((mesh.shifted([0, 0.32, 0]), material) for mesh, material in parts)
    return Model(moved, (0.62, 0.62, top))


def sofa(g: Generator) -> Model:
    """A sofa or armchair with seat cushions, arms and loose pillows."""
    seats = int(g.integers(1, 4))
    arm, seat = between(g, 0.1, 0.25), between(g, 0.55, 0.75)
    w, d = seats * seat + 2 * arm, between(g, 0.75, 1.0)
    h, back = between(g, 0.36, 0.46), between(g, 0.7, 0.95)
    rise = between(g, 0.08, 0.25)
    soft = between(g, 0.15, 0.45)
    cloth = made_of.fabric(g)
    base = pillow([w - 0.04, d, h - 0.12], square=0.12).shifted([0, d / 2, 0.06 + (h - 0.12) / 2])
    rest = pillow([w, 0.28, back], square=soft * 0.6).shifted([0, 0.14, back / 2 + 0.03])
    sides = [
        pillow([arm, d, h + rise], square=soft * 0.6).shifted([x, d / 2, (h + rise) / 2 + 0.03])
        for x in (-w / 2 + arm / 2, w / 2 - arm / 2)
    ]
    places = [-w / 2 + arm + (i + 0.5) * seat for i in range(seats)]
    cushions = [
        pillow([seat, d - 0.25, 0.2], square=soft).shifted([x, d / 2 + 0.12, h - 0.04])
        for x in places
    ]
    backs = [
        pillow([seat, 0.22, back - h + 0.05], square=soft).shifted([x, 0.33, (back + h) / 2])
        for x in places
    ]
    parts: list[Part] = [(join([base, rest, *sides, *cushions, *backs]), cloth)]
    for _ in range(int(g.integers(0, 4))):
        size = between(g, 0.3, 0.5)
        loose = pillow([size, 0.16, size], square=0.55)
        position = [
            between(g, -w / 2 + arm, w / 2 - arm),
            between(g, 0.42, 0.5),
            h + size / 2 + 0.04,
        ]
        parts.append((loose.moved(position, between(g, -0.5, 0.5)), made_of.fabric(g)))
    return Model(tuple(parts), (w, d, back))


def bed(g: Generator) -> Model:
    """A bed, head at the wall: mattress, rumpled blanket, pillows, head board."""
    w, d = between(g, 0.9, 2.0), between(g, 1.9, 2.15)
    h = between(g, 0.4, 0.62)
    frame = made_of.wood(g)
    board = between(g, h + 0.1, 1.3)
    parts: list[Part] = [
        (box([-w / 2, 0, 0], [w / 2, 0.05, board]), frame),
        (box([-w / 2, 0.05, 0.1], [w / 2, d, h - 0.18]), frame),
        (
            pillow([w - 0.04, d - 0.05, 0.24], square=0.15).shifted([0, d / 2 + 0.03, h - 0.1]),
            made_of.fabric(g),
        ),
        (legs(w, d, 0.12, 0.06, round_=False), frame),
        (_blanket(g, w, d, h), made_of.fabric(g)),
    ]
    for i in range(1 if w < 1.3 else 2):
        x = 0.0 if w < 1.3 else (i - 0.5) * w / 2
        cushion = pillow([min(0.7, w / 2), 0.45, 0.18], square=0.6).shifted([x, 0.35, h + 0.09])
        parts.append((cushion, made_of.fabric(g)))
    return Model(tuple(parts), (w, d, board), (Shelf(-w / 2, 0.9, w / 2, d, h + 0.06, 0.4),))


def _blanket(g: Generator, w: float, d: float, h: float) -> Mesh:
    """A cloth over the bed that hangs down on three sides."""
    x = np.linspace(-w / 2 - 0.25, w / 2 + 0.25, 40)
    y = np.linspace(between(g, 0.5, 1.0), d + 0.2, 40)
    gx, gy = np.meshgrid(x, y)
    over = np.maximum(np.maximum(np.abs(gx) - w / 2, gy - d), 0)
    wave = sum(
        between(g, 0.004, 0.015) * np.sin(k[0] * gx + k[1] * gy + p)
        for k, p in zip(g.uniform(-14, 14, (5, 2)), g.uniform(0, 6, 5), strict=True)
    )
    z = h + 0.05 + wave - 1.6 * over
    px = np.clip(gx, -w / 2 - 0.03, w / 2 + 0.03) + 0.3 * wave
    return sheet(np.stack([px, np.minimum(gy, d + 0.03) + 0.3 * wave, z], axis=-1))
