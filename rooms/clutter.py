"""Small things for tables, shelves and floors."""

from collections.abc import Callable

import numpy as np

from rooms import materials as made_of
from rooms.fixtures import lamp, plant
from rooms.materials import Generator
from rooms.mesh import box, boxes, can, flat_panel, join, lathe, panel, pillow, rods, sheet
from rooms.models import Model, Part, Shelf, between, chance


def _centred(parts: list[Part], w: float, d: float, h: float) -> Model:
    """A model from parts that were drawn around the origin."""
    return Model(tuple((m.shifted([0, d / 2, 0]), s) for m, s in parts), (w, d, h))


def _bottle(g: Generator) -> Model:
    r, h = between(g, 0.025, 0.06), between(g, 0.15, 0.35)
    profile = [(0, 0), (r, 0.005), (r, 0.6 * h), (0.35 * r, 0.78 * h), (0.35 * r, h), (0, h)]
    return _centred([(lathe(profile, 14), made_of.plastic(g))], 2 * r, 2 * r, h)


def _bowl(g: Generator) -> Model:
    r, h = between(g, 0.05, 0.18), between(g, 0.04, 0.14)
    t = np.linspace(0, np.pi / 2, 6)
    outer = [(float(r * np.sin(a)), float(h * (1 - np.cos(a)))) for a in t]
    inner = [(0.9 * x, z + 0.01) for x, z in outer]
    return _centred([(lathe(outer + inner[::-1], 18), made_of.plastic(g))], 2 * r, 2 * r, h)


def _cup(g: Generator) -> Model:
    r, h = between(g, 0.03, 0.045), between(g, 0.07, 0.12)
    profile = [(0, 0), (r * 0.9, 0), (r, h), (r * 0.88, h), (r * 0.8, 0.01), (0, 0.01)]
    return _centred([(lathe(profile, 12), made_of.plastic(g))], 2 * r, 2 * r, h)


def _vase(g: Generator) -> Model:
    h = between(g, 0.15, 0.5)
    radii = h * g.uniform(0.12, 0.4, 5)
    t = np.linspace(0, 1, 16)
    curve = np.interp(t, np.linspace(0, 1, 5), radii)
    profile = [(0.0, 0.0), *zip(curve.tolist(), (h * t).tolist(), strict=True)]
    r, top = float(curve.max()), h
    parts: list[Part] = [(lathe(profile, 18), made_of.plastic(g))]
    if chance(g, 0.4):
        n = int(g.integers(4, 12))
        tips = np.stack(
            [g.uniform(-0.2, 0.2, n), g.uniform(-0.2, 0.2, n), h + g.uniform(0.1, 0.4, n)], 1
        )
        parts.append((rods(np.tile([0.0, 0, h * 0.8], (n, 1)), tips, 0.004, 5), made_of.leaf(g)))
        top = float(tips[:, 2].max())
        blossom = pillow([0.06, 0.06, 0.05], square=0.9, resolution=6)
        parts.append((join([blossom.shifted(tip) for tip in tips]), made_of.printed(g)))
    return _centred(parts, 2 * r, 2 * r, top)


def _package(g: Generator) -> Model:
    w, d, h = (float(v) for v in g.uniform(0.05, 0.32, 3))
    return Model(((box([-w / 2, 0, 0], [w / 2, d, h]), made_of.printed(g)),), (w, d, h))


def _book_pile(g: Generator) -> Model:
    n = int(g.integers(1, 6))
    thickness = g.uniform(0.01, 0.045, n)
    z = np.concatenate([[0], np.cumsum(thickness)])
    parts: list[Part] = []
    for i in range(n):
        w, d = between(g, 0.14, 0.24), between(g, 0.18, 0.3)
        book = box([-w / 2, -d / 2, z[i]], [w / 2, d / 2, z[i + 1]])
        parts.append((book.moved([0, 0, 0], between(g, -0.3, 0.3)), made_of.printed(g)))
    return _centred(parts, 0.28, 0.3, float(z[-1]))


def _laptop(g: Generator) -> Model:
    case = made_of.metal(g) if chance(g, 0.5) else made_of.dark_gloss(g)
    base = box([-0.17, 0, 0], [0.17, 0.24, 0.018])
    lid = join([box([-0.17, 0, 0], [0.17, 0.008, 0.23])])
    face = panel([-0.16, 0.009, 0.01], [0.16, 0.009, 0.22])
    a = between(g, 0.05, 0.5)
    lean = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    parts = (
        (base, case),
        (lid.turned(lean).shifted([0, 0, 0.018]), case),
        (face.turned(lean).shifted([0, 0, 0.018]), made_of.screen(g)),
        (box([-0.14, 0.06, 0.018], [0.14, 0.16, 0.021]), made_of.dark_gloss(g)),
    )
    return Model(parts, (0.34, 0.3, 0.25))


def _desk_lamp(g: Generator) -> Model:
    h = between(g, 0.3, 0.55)
    knee = np.array([between(g, -0.15, 0.15), 0.0, h * 0.6])
    tip = np.array([between(g, -0.25, 0.25), between(g, -0.1, 0.1), h])
    metal = made_of.metal(g)
    head = lathe([(0.02, 0.06), (0.07, -0.03)], 14).shifted(tip)
    arms = rods(np.stack([np.zeros(3), knee]), np.stack([knee, tip]), 0.008)
    return _centred(
        [(can(0.08, 0, 0.02), metal), (arms, metal), (head, made_of.plastic(g))], 0.3, 0.2, h
    )


def _frame(g: Generator) -> Model:
    w, h = between(g, 0.1, 0.3), between(g, 0.1, 0.35)
    parts = (
        (box([-w / 2, 0.03, 0], [w / 2, 0.045, h]), made_of.wood(g)),
        (
            panel([-w / 2 + 0.015, 0.047, 0.015], [w / 2 - 0.015, 0.047, h - 0.015]),
            made_of.picture(g),
        ),
    )
    return Model(parts, (w, 0.05, h))


def _ball(g: Generator) -> Model:
    size = between(g, 0.06, 0.25)
    ball = pillow([size] * 3, square=1.0, resolution=12).shifted([0, 0, size / 2])
    return _centred([(ball, made_of.printed(g))], size, size, size)


def _heap(g: Generator) -> Model:
    """Clothes, a toy animal, a bag: a few overlapping soft lumps."""
    parts: list[Part] = []
    cloth = made_of.fabric(g)
    w, h = between(g, 0.15, 0.5), between(g, 0.08, 0.35)
    for _ in range(int(g.integers(2, 6))):
        size = np.array([w, w * 0.8, h]) * g.uniform(0.3, 0.9, 3)
        lump = pillow(size, square=between(g, 0.5, 1.0), resolution=10)
        place = [*g.uniform(-0.25, 0.25, 2) * w, size[2] / 2 + between(g, 0, 0.3) * h]
        parts.append((lump.moved(place, between(g, 0, 3)), cloth))
    return _centred(parts, w, w * 0.8, h)


def _papers(g: Generator) -> Model:
    parts: list[Part] = []
    for i in range(int(g.integers(1, 5))):
        place = [*g.uniform(-0.08, 0.08, 2), 0.002 * (i + 1)]
        parts.append((flat_panel(0.21, 0.297).moved(place, between(g, -1, 1)), made_of.picture(g)))
    return _centred(parts, 0.3, 0.35, 0.01)


def _bin(g: Generator) -> Model:
    r, h = between(g, 0.1, 0.2), between(g, 0.2, 0.6)
    profile = [(0, 0), (0.8 * r, 0), (r, h), (0.95 * r, h), (0.75 * r, 0.02), (0, 0.02)]
    return _centred([(lathe(profile, 18), made_of.plastic(g))], 2 * r, 2 * r, h)


def _carton(g: Generator) -> Model:
    """A cardboard box, open or closed, or a suitcase."""
    w, d, h = between(g, 0.2, 0.6), between(g, 0.2, 0.5), between(g, 0.15, 0.6)
    side = made_of.printed(g) if chance(g, 0.3) else made_of.wood(g)
    if chance(g, 0.5):
        return Model(((box([-w / 2, 0, 0], [w / 2, d, h]), side),), (w, d, h))
    t = 0.01
    low = np.array(
        [[-w / 2, 0, 0], [-w / 2, 0, 0], [-w / 2, d - t, 0], [-w / 2, 0, 0], [w / 2 - t, 0, 0]]
    )
    high = np.array(
        [[w / 2, d, t], [w / 2, t, h], [w / 2, d, h], [-w / 2 + t, d, h], [w / 2, d, h]]
    )
    return Model(((boxes(low, high), side),), (w, d, h))


def _basket_or_stool(g: Generator) -> Model:
    r, h = between(g, 0.15, 0.28), between(g, 0.3, 0.5)
    if chance(g, 0.5):
        return _centred(
            [(pillow([2 * r, 2 * r, h], square=0.4).shifted([0, 0, h / 2]), made_of.fabric(g))],
            2 * r,
            2 * r,
            h,
        )
    angle = np.arange(4) * np.pi / 2
    tops = np.stack(
        [0.7 * r * np.cos(angle), 0.7 * r * np.sin(angle), np.full(4, h - 0.03)], axis=1
    )
    legs = rods(tops * [1.3, 1.3, 0], tops, 0.015)
    return _centred(
        [(can(r, h - 0.03, h), made_of.wood(g)), (legs, made_of.wood(g))], 2 * r, 2 * r, h
    )


def _cable(g: Generator) -> Model:
    n = 14
    walk = np.cumsum(g.normal(0, 0.06, (n, 2)), axis=0)
    points = np.concatenate([walk - walk.mean(axis=0), np.full((n, 1), 0.01)], axis=1)
    return _centred(
        [(rods(points[:-1], points[1:], 0.006, 6), made_of.dark_gloss(g))], 0.4, 0.4, 0.02
    )


def _shoes(g: Generator) -> Model:
    leather = made_of.plastic(g)
    parts: list[Part] = []
    for x in (-0.07, 0.07):
        sole = pillow([0.09, 0.27, 0.07], square=0.6, resolution=9).shifted([x, 0, 0.035])
        heel = pillow([0.08, 0.13, 0.12], square=0.7, resolution=9).shifted([x, -0.06, 0.06])
        parts += [(sole, leather), (heel, leather)]
    return _centred(parts, 0.25, 0.28, 0.12)


def _grid_of_cans(g: Generator) -> Model:
    n = int(g.integers(2, 6))
    xy = g.uniform(-0.12, 0.12, (n, 2))
    h = g.uniform(0.05, 0.2, n)
    low = np.stack([xy[:, 0] - 0.025, xy[:, 1] - 0.025, np.zeros(n)], axis=1)
    high = low + np.stack([np.full(n, 0.05), np.full(n, 0.05), h], axis=1)
    return _centred([(boxes(low, high), made_of.printed(g))], 0.3, 0.3, float(h.max()))


def _draped_cloth(g: Generator) -> Model:
    """A towel or blanket thrown down: a rippled sheet."""
    w, d = between(g, 0.2, 0.6), between(g, 0.2, 0.5)
    x, y = np.meshgrid(np.linspace(-w / 2, w / 2, 16), np.linspace(-d / 2, d / 2, 16))
    z = 0.02 + sum(
        0.012 * (1 + np.sin(a * x + b * y + c)) for a, b, c in g.uniform(-18, 18, (4, 3))
    )
    cloth = sheet(np.stack([x, y, z], axis=-1)).moved([0, 0, 0], between(g, 0, 3))
    return _centred([(cloth, made_of.fabric(g))], w, d, 0.1)


def _small_appliance(g: Generator) -> Model:
    """A microwave, radio, coffee maker or speaker."""
    w, d, h = between(g, 0.12, 0.5), between(g, 0.12, 0.35), between(g, 0.1, 0.35)
    shell = made_of.plastic(g) if chance(g, 0.5) else made_of.dark_gloss(g)
    front = panel([-0.45 * w, d + 0.001, 0.1 * h], [between(g, 0, 0.45) * w, d + 0.001, 0.9 * h])
    face = made_of.dark_gloss(g) if chance(g, 0.6) else made_of.screen(g)
    return Model(((box([-w / 2, 0, 0], [w / 2, d, h]), shell), (front, face)), (w, d, h))


def _jars(g: Generator) -> Model:
    """A crowd of like bottles, cups or cans."""
    make = (_bottle, _cup, _bowl, _vase)[g.integers(4)]
    one = make(g)
    pitch = max(one.size[0], one.size[1]) * between(g, 1.05, 1.6)
    columns, rows = int(g.integers(2, 5)), int(g.integers(1, 3))
    parts: list[Part] = []
    for i in range(columns):
        for j in range(rows):
            shaken = g.uniform(-0.01, 0.01, 2)
            place = [(i - (columns - 1) / 2) * pitch + shaken[0], j * pitch + shaken[1], 0]
            parts += one.moved(place, 0.0)
    return Model(tuple(parts), (columns * pitch, rows * pitch, one.size[2]))


_SMALL: tuple[Callable[[Generator], Model], ...] = (
    _bottle, _bottle, _bowl, _cup, _vase, _package, _package, _book_pile, _book_pile, _laptop,
    _desk_lamp, _frame, _ball, _heap, _papers, _papers, _grid_of_cans, _draped_cloth,
    _small_appliance, _small_appliance, _jars, _jars, lamp, plant,
)  # fmt: skip
_ON_FLOOR: tuple[Callable[[Generator], Model], ...] = (
    _carton, _carton, _bin, _heap, _ball, _package, _book_pile, _basket_or_stool, _cable, _shoes,
    _vase, _draped_cloth, _papers,
)  # fmt: skip


def small_thing(g: Generator) -> Model:
    """Something that stands on a table or a shelf."""
    return _SMALL[g.integers(len(_SMALL))](g)


def floor_thing(g: Generator) -> Model:
    """Something that lies about on the floor."""
    return _ON_FLOOR[g.integers(len(_ON_FLOOR))](g)


def clutter(g: Generator, shelf: Shelf, density: float) -> list[Part]:
    """Things on a shelf that fit under its clearance and do not overlap.

    density: how many are tried per metre of width.
    """
    parts: list[Part] = []
    taken: list[tuple[float, float, float]] = []
    for _ in range(int(g.poisson(density * (shelf.x1 - shelf.x0)))):
        thing = small_thing(g)
        w, d, h = thing.size
        reach = max(w, d) / 2
        if h > shelf.clearance or reach * 2 > min(shelf.x1 - shelf.x0, 1.3 * (shelf.y1 - shelf.y0)):
            continue
        x = between(g, shelf.x0 + reach, shelf.x1 - reach)
        y = (shelf.y0 + shelf.y1) / 2 + (g.random() - 0.5) * max(
            0.0, shelf.y1 - shelf.y0 - 2 * reach
        )
        if any(np.hypot(x - a, y - b) < reach + c for a, b, c in taken):
            continue
        taken.append((x, y, reach))
        yaw = between(g, -0.6, 0.6)
        parts += thing.moved([x + d / 2 * np.sin(yaw), y - d / 2 * np.cos(yaw), shelf.z], yaw)
    return parts
