"""Lamps, plants, bathroom and other equipment: each function draws one Model at random."""

import numpy as np

from rooms import materials as made_of
from rooms.materials import Generator
from rooms.mesh import box, boxes, can, join, lathe, panel, pillow, rods, sheet
from rooms.models import Model, Part, Shelf, between, chance


def plant(g: Generator) -> Model:
    """A pot with long curved leaves."""
    r, h = between(g, 0.1, 0.22), between(g, 0.2, 0.45)
    pot = lathe([(0.0, 0), (0.7 * r, 0), (r, h), (0.9 * r, h), (0.85 * r, h - 0.04), (0, h - 0.04)])
    reach, rise = between(g, 0.2, 0.5), between(g, 0.3, 1.2)
    width = between(g, 0.02, 0.08)
    t = np.linspace(0, 1, 7)[:, None]
    side = np.array([-1.0, 0.0, 1.0])[None]
    blade = sheet(
        np.stack(
            [
                reach * t**1.3 + 0 * side,
                width * side * np.sin(np.pi * (0.1 + 0.9 * t)),
                rise * np.sin(1.9 * t) + 0.01 * np.abs(side),
            ],
            axis=-1,
        )
    )
    leaves = [
        blade.scaled([*g.uniform(0.4, 1.0, 2), between(g, 0.4, 1.0)]).moved([0, 0, h], angle)
        for angle in g.uniform(0, 2 * np.pi, int(g.integers(8, 26)))
    ]
    size = max(2 * r, 1.2 * reach)
    parts = ((pot, made_of.plastic(g)), (join(leaves), made_of.leaf(g)))
    return Model(tuple((m.shifted([0, size / 2, 0]), s) for m, s in parts), (size, size, h + rise))


def lamp(g: Generator) -> Model:
    """A standing or a table lamp with a cloth shade, mostly lit."""
    standing = chance(g, 0.5)
    h = between(g, 1.2, 1.7) if standing else between(g, 0.3, 0.6)
    r = between(g, 0.1, 0.25) if standing else between(g, 0.08, 0.16)
    foot = made_of.metal(g) if standing else made_of.plastic(g)
    lit = chance(g, 0.65)
    warm = np.array([1.0, 0.8, 0.5], dtype=np.float32) * between(g, 0.8, 1.2)
    shade = made_of.emitter(warm, between(g, 1.0, 4.0)) if lit else made_of.fabric(g)
    if standing:
        body = join([rods(np.array([[0, 0, 0]]), np.array([[0, 0, h]]), 0.012), can(0.14, 0, 0.03)])
    else:
        radii = g.uniform(0.02, 0.09, 4)
        body = lathe([(0, 0), *zip(radii.tolist(), [0.0, 0.3 * h, 0.6 * h, h], strict=True)], 14)
    cone = lathe([(r, h - 0.08), (r * between(g, 0.4, 1.0), h + r)])
    parts = tuple(
        (mesh.shifted([0, r, 0]), material) for mesh, material in ((body, foot), (cone, shade))
    )
    return Model(parts, (2 * r, 2 * r, h + r), bulbs=((0.0, r, h),) if lit else ())


def toilet(g: Generator) -> Model:
    """A toilet with its cistern."""
    white = made_of.ceramic(g)
    bowl = lathe([(0.0, 0.0), (0.12, 0.0), (0.11, 0.15), (0.19, 0.38), (0.19, 0.4), (0.0, 0.4)])
    parts = (
        (bowl.scaled([1.0, 1.25, 1.0]).shifted([0, 0.4, 0]), white),
        (pillow([0.38, 0.46, 0.04], square=0.8).shifted([0, 0.41, 0.42]), white),
        (box([-0.2, 0.0, 0.35], [0.2, 0.18, 0.78]), white),
    )
    return Model(parts, (0.4, 0.66, 0.78))


def washbasin(g: Generator) -> Model:
    """A basin in a vanity or on a column, a tap, a mirror above."""
    white, tap = made_of.ceramic(g), made_of.metal(g)
    w, h = between(g, 0.5, 1.2), between(g, 0.78, 0.9)
    dish = lathe(
        [(0.0, h - 0.12), (0.14, h - 0.1), (0.2, h + 0.01), (0.23, h + 0.012), (0.23, h - 0.06)]
    )
    parts: list[Part] = [(dish.shifted([0, 0.27, 0]), white)]
    if chance(g, 0.65):
        body = made_of.wood(g)
        ring = [
            [-w / 2, 0, h - 0.03],
            [-w / 2, 0, h - 0.03],
            [0.2, 0, h - 0.03],
            [-0.2, 0, h - 0.03],
            [-0.2, 0.46, h - 0.03],
        ]
        high = [[w / 2, 0.06, h], [-0.2, 0.52, h], [w / 2, 0.52, h], [0.2, 0.08, h], [0.2, 0.52, h]]
        parts += [(boxes(np.array(ring), np.array(high)), white)]
        parts += [(box([-w / 2 + 0.02, 0, 0.08], [w / 2 - 0.02, 0.5, h - 0.14]), body)]
    else:
        parts.append((lathe([(0.1, 0), (0.07, 0.2), (0.08, h - 0.1)]).shifted([0, 0.2, 0]), white))
    spout = np.array([[0, 0.05, h], [0, 0.05, h + 0.14]])
    parts.append((rods(spout, np.array([[0, 0.05, h + 0.14], [0, 0.2, h + 0.11]]), 0.013), tap))
    top = h
    if chance(g, 0.8):
        top = between(g, 1.7, 2.0)
        pane = panel([-w / 2, 0.02, h + 0.2], [w / 2, 0.02, top])
        parts += [
            (pane, made_of.mirror(g)),
            (box([-w / 2, 0, h + 0.2], [w / 2, 0.018, top]), made_of.wood(g)),
        ]
    shelf = Shelf(-w / 2, 0.0, -0.22, 0.4, h, 0.25)
    return Model(tuple(parts), (max(w, 0.5), 0.54, top), (shelf,))


def bathtub(g: Generator) -> Model:
    """A tub along the wall, sometimes with a shower curtain."""
    w, d, h = between(g, 1.5, 1.8), between(g, 0.7, 0.85), between(g, 0.5, 0.62)
    white = made_of.ceramic(g)
    t = 0.07
    low = np.array(
        [[-w / 2, 0, 0], [-w / 2, d - t, 0], [-w / 2, 0, 0], [w / 2 - t, 0, 0], [-w / 2, 0, 0]]
    )
    high = np.array(
        [[w / 2, t, h], [w / 2, d, h], [-w / 2 + t, d, h], [w / 2, d, h], [w / 2, d, 0.15]]
    )
    parts: list[Part] = [(boxes(low, high), white)]
    if chance(g, 0.5):
        span = between(g, 0.3, 0.9) * w
        x = np.linspace(-w / 2, -w / 2 + span, 60)
        z = np.array([2.0, 0.25])[:, None]
        y = d + 0.03 * np.sin(between(g, 25, 60) * x) + 0 * z
        parts.append((sheet(np.stack([x + 0 * z, y, z + 0 * x], axis=-1)), made_of.fabric(g)))
        rail = np.array([[-w / 2, d, 2.0]])
        parts.append((rods(rail, rail * [-1, 1, 1], 0.012), made_of.metal(g)))
    return Model(tuple(parts), (w, d + 0.04, 2.0), (Shelf(-w / 2, 0, w / 2, 0.1, h, 0.2),))


def radiator(g: Generator) -> Model:
    """Vertical ribs below a window height."""
    w, h = between(g, 0.5, 1.6), between(g, 0.5, 0.75)
    x = np.arange(-w / 2, w / 2, 0.055)
    low = np.stack([x, np.full_like(x, 0.04), np.full_like(x, 0.12)], axis=1)
    return Model(
        ((boxes(low, low + np.array([[0.04, 0.08, h - 0.12]])), made_of.ceramic(g)),), (w, 0.13, h)
    )


def clothes_rack(g: Generator) -> Model:
    """Thin bars, with some cloth hanging from them; or a drying rack."""
    w, h = between(g, 0.6, 1.3), between(g, 0.9, 1.7)
    d = 0.45
    x = w / 2
    feet = np.array([[-x, 0, 0], [x, 0, 0], [-x, d, 0], [x, d, 0], [-x, d / 2, h]])
    tops = np.array([[-x, d / 2, h], [x, d / 2, h], [-x, d / 2, h], [x, d / 2, h], [x, d / 2, h]])
    parts: list[Part] = [(rods(feet, tops, between(g, 0.006, 0.015)), made_of.metal(g))]
    for _ in range(int(g.integers(0, 6))):
        left = between(g, -x, x - 0.15)
        along = np.linspace(0, between(g, 0.1, 0.4), 14)
        down = np.linspace(0, between(g, 0.3, 0.8 * h), 8)[:, None]
        wave = 0.03 * np.sin(between(g, 10, 40) * along) * down
        cloth = np.stack([left + along + 0 * down, d / 2 + wave, h - down + 0 * along], axis=-1)
        parts.append((sheet(cloth), made_of.fabric(g)))
    return Model(tuple(parts), (w, d, h))


def ladder(g: Generator) -> Model:
    """A ladder that leans on the wall."""
    w, h, foot = between(g, 0.35, 0.5), between(g, 1.2, 2.2), between(g, 0.3, 0.6)
    rungs = np.arange(0.2, h - 0.1, 0.27)
    y = foot * (1 - rungs / h)
    starts = np.stack([np.full_like(y, -w / 2), y, rungs], axis=1)
    rails = np.array([[-w / 2, foot, 0], [w / 2, foot, 0]])
    tops = np.array([[-w / 2, 0.02, h], [w / 2, 0.02, h]])
    steps = rods(starts, starts * [-1, 1, 1], 0.013)
    return Model(((join([rods(rails, tops, 0.02), steps]), made_of.wood(g)),), (w, foot, h))


def board(g: Generator) -> Model:
    """A whiteboard or blackboard on legs."""
    w, h = between(g, 0.9, 1.8), between(g, 1.6, 2.0)
    face = made_of.ceramic(g) if chance(g, 0.5) else made_of.picture(g)
    x = w / 2
    posts = rods(
        np.array([[-x, 0.3, 0], [x, 0.3, 0]]), np.array([[-x, 0.3, h], [x, 0.3, h]]), 0.018
    )
    feet = rods(
        np.array([[-x, 0, 0.03], [x, 0, 0.03]]), np.array([[-x, 0.6, 0.03], [x, 0.6, 0.03]]), 0.018
    )
    plate = panel([-x, 0.31, 0.75], [x, 0.31, h])
    frame = box([-x, 0.29, 0.73], [x, 0.308, h + 0.02])
    steel = made_of.metal(g)
    return Model(((plate, face), (join([posts, feet, frame]), steel)), (w, 0.6, h))


def person(g: Generator) -> Model:
    """A rough standing figure of rounded lumps."""
    h = between(g, 1.5, 1.85)
    top, trousers = made_of.fabric(g), made_of.fabric(g)
    skin = made_of.skin(g)

    def limb(a: tuple[float, float, float], b: tuple[float, float, float], r: float) -> Part:
        points = np.array([a, b]) * h
        ball = [pillow([2 * r] * 3, square=1.0, resolution=8).shifted(p) for p in points]
        return (join([rods(points[:1], points[1:], r), *ball]), trousers if b[2] < 0.1 else top)

    sway = between(g, -0.1, 0.1)
    parts = [
        limb((-0.05, 0.0, 0.5), (-0.06, sway, 0.04), 0.065),
        limb((0.05, 0.0, 0.5), (0.06, -sway, 0.04), 0.065),
        limb((-0.12, 0.0, 0.78), (-0.15, between(g, 0, 0.2), 0.5), 0.045),
        limb((0.12, 0.0, 0.78), (0.15, between(g, 0, 0.2), 0.5), 0.045),
        (pillow([0.38, 0.24, 0.36 * h], square=0.6).shifted([0, 0, 0.66 * h]), top),
        (pillow([0.16, 0.2, 0.24], square=1.0).shifted([0, 0.02, 0.92 * h]), skin),
        (
            pillow([0.18, 0.2, 0.18], square=1.0).shifted([0, -0.02, 0.95 * h]),
            made_of.dark_gloss(g),
        ),
    ]
    return Model(tuple((m.shifted([0, 0.25, 0]), s) for m, s in parts), (0.55, 0.5, h))
