"""A random street: road, kerbs, facades, trees, cars, people under an open sky.

x runs along the street, y across it, the road's middle is at y = 0.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rooms import fixtures
from rooms import materials as made_of
from rooms.materials import Generator, Material
from rooms.mesh import Mesh, box, boxes, can, join, lathe, pillow, rods, sheet
from rooms.models import Light, Part, Sun, between, chance

# how far the street reaches to both sides of the camera [m], and where the sky is
REACH, SKY_M = 80.0, 95.0
KERB = 0.13  # height of pavements above the road [m]
PANE = 0.05  # how far a window's frame stands out [m]


@dataclass
class Street:
    """A street under construction.

    half: half the road's width [m]. front: how far the buildings are from its middle [m].
    """

    half: float
    front: float
    ambient: Float[np.ndarray, "3"]
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    sun: Sun | None = None

    def add(self, parts: list[Part], x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> None:
        """Stands parts at a place, turned about z by `yaw`."""
        self.parts += [(mesh.moved([x, y, z], yaw), material) for mesh, material in parts]


def build_street(g: Generator) -> Street:
    """Everything of one street; the randomness of `g` alone."""
    half = between(g, 2.6, 7.0)
    street = Street(half, half + between(g, 1.5, 9.0), np.full(3, between(g, 0.1, 0.4)))
    street.parts.append((_dome(), made_of.sky(g, between(g, 0.8, 2.5))))
    if chance(g, 0.7):
        height, aside = np.radians(between(g, 15, 60)), between(g, 0, 2 * np.pi)
        level = np.array([np.cos(aside), np.sin(aside), 0]) * np.cos(height)
        power = between(g, 1.5, 4.5) * np.array([1.0, 0.95, 0.85])
        street.sun = Sun(level + np.array([0, 0, np.sin(height)]), power)
    _ground(g, street)
    built_up, green = g.random(), g.random()
    for side in (-1, 1):
        _row_of_buildings(g, street, side, built_up)
        _along_the_pavement(g, street, side, green)
    if chance(g, 0.5):  # the street ends at a house
        _building(g, street, between(g, 20, 75) * g.choice([-1, 1]), 0, np.pi / 2, street.front * 2)
    for _ in range(int(g.poisson(4))):
        lane = g.choice([-0.5, 0.5]) * street.half
        street.add(vehicle(g), between(g, -60, 60), lane, np.pi / 2 * g.choice([-1, 1]))
    return street


def _dome() -> Mesh:
    """The sky, all around."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 12)
    return lathe([(SKY_M * float(np.cos(a)), SKY_M * float(np.sin(a))) for a in angle], 32)


def _ground(g: Generator, street: Street) -> None:
    """Road with its markings, pavements, and what lies behind them."""
    half, reach = street.half, REACH + 10
    road, pavement = made_of.asphalt(g), made_of.asphalt(g)
    beyond = made_of.leaf(g) if chance(g, 0.6) else made_of.asphalt(g)
    street.parts.append((box([-reach, -half, -0.2], [reach, half, 0]), road))
    for side in (-1, 1):
        near, far, end = sorted((side * half, side * street.front)), side * street.front, side * 90
        street.parts.append((box([-reach, near[0], -0.2], [reach, near[1], KERB]), pavement))
        low, high = sorted((far, end))
        street.parts.append((box([-reach, low, -0.2], [reach, high, KERB]), beyond))
    white = made_of.road_paint(g)
    dash, gap = between(g, 2, 6), between(g, 2, 8)
    x = np.arange(-REACH, REACH, dash + gap)
    if chance(g, 0.75):
        dashes = np.stack([x, np.full_like(x, -0.08), np.zeros_like(x)], axis=1)
        street.parts.append((boxes(dashes, dashes + np.array([dash, 0.16, 0.004])), white))
    if chance(g, 0.4):
        edge = half - 0.3
        lines = np.array([[-reach, -edge, 0], [-reach, edge - 0.14, 0]])
        street.parts.append((boxes(lines, lines + np.array([2 * reach, 0.14, 0.004])), white))


def _row_of_buildings(g: Generator, street: Street, side: int, built_up: float) -> None:
    """Facades side by side, or single houses with gardens, or only a hedge."""
    x = -REACH + between(g, 0, 10)
    while x < REACH:
        width = between(g, 7, 22)
        if chance(g, built_up):
            depth = 0.0 if built_up > 0.6 else between(g, 0, 8)
            yaw = 0.0 if side < 0 else np.pi
            y = side * (street.front + depth)
            _building(g, street, x + width / 2, y, yaw, width)
        elif chance(g, 0.6):
            _hedge(g, street, x, width, side)
        x += width + (0.0 if chance(g, built_up) else between(g, 0, 12))


def _building(g: Generator, street: Street, x: float, y: float, yaw: float, width: float) -> None:
    """A block with rows of windows and a door in its front, flat or with a gable roof.

    Its front is at local y = 0 and looks towards +y.
    """
    storey, storeys = between(g, 2.7, 3.8), int(g.integers(1, 6))
    height, depth = storey * storeys + between(g, 0.3, 1.0), between(g, 6, 12)
    wall = made_of.facade(g)
    parts: list[Part] = [(box([-width / 2, -depth, 0], [width / 2, 0, height]), wall)]
    parts += _windows(g, width, storey, storeys)
    door = between(g, -width / 3, width / 3)
    parts.append((box([door, 0, 0], [door + between(g, 0.9, 2.5), 0.06, 2.2]), made_of.wood(g)))
    if chance(g, 0.3):  # a shop's awning, a balcony
        parts.append((box([door - 1, 0, 2.5], [door + 3, between(g, 0.6, 1.6), 2.7]), wall))
    if chance(g, 0.6):
        rise, tiles = between(g, 1.5, 4.5), made_of.roof(g)
        ridge = np.array([[0.4, height - 0.1], [-depth / 2, height + rise], [-depth, height - 0.1]])
        edges = np.array([-width / 2 - 0.3, width / 2 + 0.3])
        grid = [[(edge, *point) for edge in edges] for point in ridge]
        parts += [(sheet(np.array(slope)), tiles) for slope in (grid[:2], grid[1:])]
    street.add(parts, x, y, yaw)


def _windows(g: Generator, width: float, storey: float, storeys: int) -> list[Part]:
    """Panes with frames that stand out of a front, alike, in rows."""
    w, h = between(g, 0.8, 1.8), between(g, 1.1, 0.75 * storey)
    columns = np.arange(-width / 2 + 0.8, width / 2 - w - 0.4, w + between(g, 0.5, 2.0))
    rows = storey * np.arange(storeys) + between(g, 0.6, 0.9)
    x, z = (v.ravel() for v in np.meshgrid(columns, rows))
    if not len(x):
        return []
    low = np.stack([x, np.zeros_like(x), z], axis=1)
    t = 0.07
    bars = [([-t, 0, -t], [0, PANE, h + t]), ([w, 0, -t], [w + t, PANE, h + t])]
    bars += [([0, 0, -t], [w, 2 * PANE, 0]), ([0, 0, h], [w, PANE, h + t])]
    if chance(g, 0.5):
        bars.append(([w / 2 - 0.03, 0, 0], [w / 2 + 0.03, PANE, h]))
    frames = join([boxes(low + np.array(a), low + np.array(b)) for a, b in bars])
    panes = boxes(low, low + np.array([w, 0.01, h]))
    return [(panes, made_of.dark_gloss(g)), (frames, made_of.plastic(g))]


def _hedge(g: Generator, street: Street, x: float, width: float, side: int) -> None:
    """A hedge, a wall, or a fence."""
    y, h = side * street.front, between(g, 0.8, 2.2)
    draw = g.random()
    if draw < 0.5:
        parts = _foliage(g, np.array([width, 1.2, h]), int(6 * width))
        street.add(parts, x + width / 2, y + side * 0.8, 0.0, h / 2)
    elif draw < 0.75:
        street.parts.append((box([x, y - 0.12, 0], [x + width, y + 0.12, h]), made_of.facade(g)))
    else:
        posts = np.arange(x, x + width, between(g, 0.12, 0.5))
        foot = np.stack([posts, np.full_like(posts, y), np.zeros_like(posts)], axis=1)
        rails = np.array([[x, y, 0.9 * h], [x, y, 0.2 * h]])
        up, along = np.array([0, 0, h]), np.array([width, 0, 0])
        fence = [rods(foot, foot + up, 0.02), rods(rails, rails + along, 0.03)]
        street.parts.append((join(fence), made_of.metal(g)))


def _along_the_pavement(g: Generator, street: Street, side: int, green: float) -> None:
    """Parked cars, trees, posts and people."""
    middle = side * (street.half + street.front) / 2
    x = -REACH + between(g, 0, 8)
    parking, posts = chance(g, 0.6), between(g, 15, 40)
    while x < REACH:
        if parking and chance(g, 0.6):
            street.add(vehicle(g), x, side * (street.half - 1.0), np.pi / 2 * g.choice([-1, 1]))
        if chance(g, 0.5 * green):
            street.add(tree(g), x + between(g, -2, 2), side * between(g, street.half + 0.5, 16))
        if chance(g, 0.2):
            at = between(g, street.half + 0.4, street.front)
            street.add(list(fixtures.person(g).parts), x, side * at, between(g, 0, 6.3), KERB)
        x += between(g, 5, 9)
    for at in np.arange(-REACH + between(g, 0, posts), REACH, posts):
        street.add(_post(g), at, middle if chance(g, 0.3) else side * (street.half + 0.4))


def _post(g: Generator) -> list[Part]:
    """A lamp post, a sign or a bollard."""
    h, metal = between(g, 0.9, 7.0), made_of.metal(g)
    pole = rods(np.zeros((1, 3)), np.array([[0, 0, h]]), between(g, 0.03, 0.1))
    parts: list[Part] = [(pole, metal)]
    if 2 < h < 4:
        parts.append((box([-0.3, 0.02, h - 0.7], [0.3, 0.05, h]), made_of.picture(g)))
    elif h >= 4:
        parts.append((box([-0.15, 0, h - 0.1], [0.15, 1.5, h]), metal))
    return parts


def tree(g: Generator) -> list[Part]:
    """A trunk under a crown."""
    trunk, crown = between(g, 1.2, 3.5), g.uniform([2, 2, 2], [5, 5, 7])
    stem = rods(np.zeros((1, 3)), np.array([[0, 0, trunk + 1]]), between(g, 0.1, 0.3))
    leaves = _foliage(g, crown, int(g.integers(50, 140)))
    top = trunk + crown[2] / 2
    crown_parts = [(mesh.shifted([0, 0, top]), material) for mesh, material in leaves]
    return [(stem, made_of.wood(g)), *crown_parts]


def _foliage(g: Generator, size: Float[np.ndarray, "3"], count: int) -> list[Part]:
    """Clumps of leaves that fill a box about the origin, in two greens."""
    greens = made_of.leaf(g), made_of.leaf(g)
    places = g.uniform(-0.42, 0.42, (count, 3)) * size
    radius = between(g, 0.2, 0.45) * float(size.min())
    clumps = [
        pillow(radius * g.uniform(0.3, 1.1, 3), square=1.0, resolution=6).shifted(place)
        for place in places
    ]
    return [(join(clumps[i::2]), greens[i]) for i in range(2) if clumps[i::2]]


def vehicle(g: Generator) -> list[Part]:
    """A car, van or lorry on wheels, along y, its middle at the origin."""
    large = chance(g, 0.2)
    w = between(g, 1.65, 1.9) + 0.5 * large
    length = between(g, 5.0, 9.0) if large else between(g, 3.6, 4.8)
    h = between(g, 2.2, 3.4) if large else between(g, 1.35, 1.75)
    belt = (0.45 if large else 0.58) * h
    paint, glass = made_of.plastic(g), made_of.dark_gloss(g)
    body = pillow([w, length, belt - 0.2], square=0.3).shifted([0, 0, (belt + 0.2) / 2])
    parts: list[Part] = [(body, paint)]
    if large:
        parts.append((box([-w / 2, -length / 2, 0.6], [w / 2, 0.3 * length, h]), _side(g)))
        cab = box([-w / 2, 0.32 * length, 0.5], [w / 2, 0.49 * length, 0.8 * h])
        parts += [(cab, paint), (cab.scaled([0.9, 1.01, 0.5]).shifted([0, 0, 0.36 * h]), glass)]
    else:
        z, rear = belt - 0.15, between(g, -0.06, -0.02) * length
        cabin = pillow([0.86 * w, between(g, 0.5, 0.6) * length, 2 * (h - z)], square=0.5)
        parts.append((cabin.shifted([0, rear, z]), glass))
        roof = pillow([0.8 * w, 0.36 * length, 0.16], square=0.4).shifted([0, rear, h - 0.04])
        parts.append((roof, paint))
        for end, colour in ((0.485, 0.9), (-0.485, 0.3)):
            lamps = [box([x - 0.18, -0.03, 0], [x + 0.18, 0.03, 0.13]) for x in (-0.6, 0.6)]
            parts.append((join(lamps).shifted([0, end * length, 0.42 * h]), _lamp(colour)))
    return [*parts, *_wheels(g, w, length)]


def _side(g: Generator) -> Material:
    """A lorry's flank: plain, or printed."""
    return made_of.printed(g) if chance(g, 0.4) else made_of.plastic(g)


def _lamp(colour: float) -> Material:
    """A white lamp for .9, a red one for less."""
    tint = np.array([0.9, colour * 0.9, colour * colour], np.float32)
    return made_of.emitter(tint, 0.7)


def _wheels(g: Generator, w: float, length: float) -> list[Part]:
    r = between(g, 0.29, 0.36)
    upright = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    tyre, rim = can(r, -0.1, 0.1).turned(upright), can(0.6 * r, -0.11, 0.11).turned(upright)
    places = [[x * (w / 2 - 0.1), y * length, r] for x in (-1, 1) for y in (-0.31, 0.31)]
    return [
        (join([tyre.shifted(place) for place in places]), made_of.dark_gloss(g)),
        (join([rim.shifted(place) for place in places]), made_of.metal(g)),
    ]
