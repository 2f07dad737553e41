"""Tables and what belongs to them: each function draws one Model at random."""

import numpy as np

from rooms import materials as made_of
from rooms.materials import Generator
from rooms.mesh import Mesh, box, boxes, can, lathe, panel, rods
from rooms.models import Model, Part, Shelf, between, chance
from rooms.storage import drawers


def legs(
    w: float, d: float, h: float, thickness: float, *, round_: bool, splay: float = 0.0
) -> Mesh:
    """Four legs at the corners of a w x d rectangle that starts at y = 0."""
    inset = thickness
    xs = np.array([-1, 1, -1, 1]) * (w / 2 - inset)
    ys = np.array([inset, inset, d - inset, d - inset])
    tops = np.stack([xs, ys, np.full(4, h)], axis=1)
    feet = tops * [1 + splay, 1, 0]
    feet[:, 1] += splay * np.sign(ys - d / 2) * d / 2
    if round_:
        return rods(feet, tops, thickness / 2)
    half = np.array([thickness / 2, thickness / 2, 0])
    return boxes(feet * [1, 1, 0] - half, tops * [1, 1, 1] + half)


def table(g: Generator) -> Model:
    """A dining, coffee or side table, round or square, with legs or one foot."""
    w, d = between(g, 0.5, 2.0), between(g, 0.45, 1.0)
    h = between(g, 0.38, 0.8)
    top_material = made_of.wood(g) if chance(g, 0.7) else made_of.plastic(g)
    leg_material = top_material if chance(g, 0.6) else made_of.metal(g)
    t = between(g, 0.015, 0.06)
    if chance(g, 0.25):
        d = w = min(w, 1.3)
        top = can(w / 2, h - t, h).shifted([0, d / 2, 0])
        foot = lathe([(0.25 * w, 0), (0.24 * w, 0.02), (0.03, 0.05), (0.03, h - t)], 16)
        parts: list[Part] = [(top, top_material), (foot.shifted([0, d / 2, 0]), leg_material)]
        inner = 0.33 * w
        shelf = Shelf(-inner, d / 2 - inner, inner, d / 2 + inner, h, 0.6)
        return Model(tuple(parts), (w, d, h), (shelf,))
    four = legs(w, d, h - t, between(g, 0.025, 0.08), round_=chance(g, 0.4))
    parts = [(box([-w / 2, 0, h - t], [w / 2, d, h]), top_material), (four, leg_material)]
    if chance(g, 0.5):  # apron
        parts.append(
            (
                box([-w / 2 + 0.05, 0.05, h - t - 0.08], [w / 2 - 0.05, d - 0.05, h - t]),
                leg_material,
            )
        )
    return Model(tuple(parts), (w, d, h), (Shelf(-w / 2, 0, w / 2, d, h, 0.6),))


def desk(g: Generator) -> Model:
    """A desk with drawers, a screen, a keyboard, papers."""
    w, d, h = between(g, 1.0, 1.8), between(g, 0.55, 0.8), between(g, 0.7, 0.78)
    body = made_of.wood(g)
    parts: list[Part] = [
        (box([-w / 2, 0, h - 0.03], [w / 2, d, h]), body),
        (
            legs(w, d, h - 0.03, 0.05, round_=chance(g, 0.3)),
            made_of.metal(g) if chance(g, 0.5) else body,
        ),
    ]
    if chance(g, 0.6):
        x = (w / 2 - 0.45) * g.choice([-1.0, 1.0])
        parts += drawers(g, 0.4, d - 0.08, h - 0.05, rows=3, body=body).moved([x, 0, 0], 0)
    for _ in range(int(g.integers(1, 3))):
        x = between(g, -w / 2 + 0.3, w / 2 - 0.3)
        parts += monitor(g).moved([x, 0.08, h], between(g, -0.3, 0.3))
    parts.append((box([-0.2, d - 0.3, h], [0.2, d - 0.15, h + 0.02]), made_of.plastic(g)))
    return Model(tuple(parts), (w, d, h + 0.6), (Shelf(-w / 2, 0.3 * d, w / 2, d, h, 0.5),))


def monitor(g: Generator) -> Model:
    """A screen on a foot, on or off."""
    w = between(g, 0.4, 0.75)
    h = w * between(g, 0.56, 0.75)
    z = between(g, 0.06, 0.15)
    case = made_of.dark_gloss(g) if chance(g, 0.7) else made_of.plastic(g)
    face = made_of.dark_gloss(g) if chance(g, 0.5) else made_of.screen(g)
    parts = (
        (box([-w / 2, 0.1, z], [w / 2, 0.14, z + h]), case),
        (panel([-w / 2 + 0.015, 0.142, z + 0.015], [w / 2 - 0.015, 0.142, z + h - 0.015]), face),
        (box([-0.03, 0.08, 0], [0.03, 0.11, z + 0.1]), case),
        (box([-0.12, 0, 0], [0.12, 0.2, 0.015]), case),
    )
    return Model(parts, (w, 0.2, z + h))


def tv_stand(g: Generator) -> Model:
    """A low board with a large screen."""
    base = drawers(
        g, between(g, 1.0, 1.8), 0.4, between(g, 0.35, 0.6), rows=2, body=made_of.wood(g)
    )
    width = between(g, 0.8, 1.3)
    face = made_of.dark_gloss(g) if chance(g, 0.7) else made_of.screen(g)
    z = base.size[2]
    parts: list[Part] = [
        (
            box([-width / 2, 0.15, z + 0.06], [width / 2, 0.2, z + 0.06 + 0.58 * width]),
            made_of.dark_gloss(g),
        ),
        (
            panel(
                [-width / 2 + 0.02, 0.203, z + 0.08],
                [width / 2 - 0.02, 0.203, z + 0.04 + 0.58 * width],
            ),
            face,
        ),
        (box([-0.2, 0.1, z], [0.2, 0.3, z + 0.07]), made_of.dark_gloss(g)),
    ]
    return Model((*base.parts, *parts), (base.size[0], 0.45, z + 0.64 * width), base.shelves)
