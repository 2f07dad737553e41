"""Furniture: each function draws one Model at random."""

import numpy as np

from training.rooms import materials as made_of
from training.rooms.materials import Generator
from training.rooms.mesh import Mesh, box, boxes, can, join, lathe, panel, pillow, rods, sheet
from training.rooms.models import Model, Part, Shelf, between, chance


def _legs(
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
    legs = _legs(w, d, h - t, between(g, 0.025, 0.08), round_=chance(g, 0.4))
    parts = [(box([-w / 2, 0, h - t], [w / 2, d, h]), top_material), (legs, leg_material)]
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
            _legs(w, d, h - 0.03, 0.05, round_=chance(g, 0.3)),
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
    return Model(tuple(parts), (w, d, h), (Shelf(-w / 2, 0.3 * d, w / 2, d, h, 0.5),))


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
        centre + [-reach, 0.03, 0.0], centre + [reach, 0.03, 0.0], between(g, 0.004, 0.01), 6
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
    """Tall, with doors; some have dark gloss or mirror fronts. Also a refrigerator."""
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
        (rods(knobs - [0, 0, 0.1], knobs + [0, 0, 0.1], 0.008, 6), made_of.metal(g)),
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


def chair(g: Generator) -> Model:
    """A dining chair: legs, seat, a back of slats, a board or a cushion."""
    w, d = between(g, 0.38, 0.5), between(g, 0.4, 0.5)
    h, top = between(g, 0.42, 0.48), between(g, 0.75, 1.05)
    frame = made_of.wood(g) if chance(g, 0.6) else made_of.metal(g)
    seat = made_of.fabric(g) if chance(g, 0.5) else frame
    thin = between(g, 0.02, 0.045)
    parts: list[Part] = [
        (_legs(w, d, h, thin, round_=chance(g, 0.5), splay=between(g, 0, 0.15)), frame)
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
            slats = rods(a, a + [0, -0.08, top - h - 0.03], 0.009, 6)
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
        parts.append((rods(a, a + [0, 0.28, 0], 0.02, 6), frame))
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
        (_legs(w, d, 0.12, 0.06, round_=False), frame),
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


def floor_lamp(g: Generator) -> Model:
    """A lamp on a thin pole, switched off (lit lamps are added with the lights)."""
    h, r = between(g, 1.2, 1.8), between(g, 0.12, 0.25)
    pole, shade = made_of.metal(g), made_of.fabric(g)
    parts = (
        (rods(np.array([[0, 0, 0]]), np.array([[0, 0, h]]), 0.012), pole),
        (can(0.14, 0, 0.03), pole),
        (lathe([(r, h - 0.1), (r * between(g, 0.4, 1.0), h + 0.2)]), shade),
    )
    moved = tuple((mesh.shifted([0, r, 0]), material) for mesh, material in parts)
    return Model(moved, (2 * r, 2 * r, h + 0.2))


def plant(g: Generator) -> Model:
    """A pot with long curved leaves."""
    r, h = between(g, 0.1, 0.22), between(g, 0.2, 0.45)
    pot = lathe([(0.0, 0), (0.7 * r, 0), (r, h), (0.9 * r, h), (0.85 * r, h - 0.04), (0, h - 0.04)])
    reach, rise = between(g, 0.2, 0.5), between(g, 0.3, 1.2)
    width = between(g, 0.02, 0.08)
    t = np.linspace(0, 1, 7)[:, None]
    side = np.array([-1.0, 0.0, 1.0])[None]
    leaves = []
    for angle in g.uniform(0, 2 * np.pi, int(g.integers(8, 26))):
        length, lift = reach * between(g, 0.4, 1.0), rise * between(g, 0.4, 1.0)
        blade = np.stack(
            [
                length * t**1.3 + 0 * side,
                width * side * np.sin(np.pi * (0.1 + 0.9 * t)),
                h + lift * np.sin(1.9 * t) + 0.01 * np.abs(side),
            ],
            axis=-1,
        )
        leaves.append(sheet(blade).moved([0, 0, 0], angle))
    size = max(2 * r, 1.2 * reach)
    parts = ((pot, made_of.plastic(g)), (join(leaves), made_of.leaf(g)))
    return Model(tuple((m.shifted([0, size / 2, 0]), s) for m, s in parts), (size, size, h + rise))


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
            (rods(grip - [0, 0, 0.07], grip + [0, 0, 0.07], 0.006, 6), made_of.metal(g)),
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
