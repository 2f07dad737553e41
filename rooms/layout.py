"""A random room: its shell, furniture, clutter and lights."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rooms import materials as made_of
from rooms import seating, tables
from rooms.clutter import clutter, floor_thing
from rooms.decor import on_wall
from rooms.lamps import add_lamps, bulb, sunshine, window_light
from rooms.materials import Generator, Material
from rooms.mesh import box, flat_panel, sheet
from rooms.models import Light, Model, Part, Sun, between, chance
from rooms.shell import (
    Opening,
    Wall,
    cladding,
    door,
    other_room,
    room_walls,
    slab,
    wall_mesh,
    window,
)
from rooms.themes import THEMES, Make, Theme

Rectangle = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]
FREE_RADIUS = 0.4  # around the camera [m]


@dataclass
class Room:
    """A room under construction, 0..width by 0..depth [m], and what stands in it.

    eye: where the camera stands; its surroundings stay free.
    """

    theme: Theme
    width: float
    depth: float
    height: float
    eye: tuple[float, float]
    ambient: Float[np.ndarray, "3"]
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    sun: Sun | None = None
    taken: list[Rectangle] = field(default_factory=list)

    def fits(self, rectangle: Rectangle) -> bool:
        """True if the rectangle is inside the room and hits nothing that stands there."""
        x0, y0, x1, y1 = rectangle
        if x0 < -0.01 or y0 < -0.01 or x1 > self.width + 0.01 or y1 > self.depth + 0.01:
            return False
        return all(x1 <= a or x0 >= c or y1 <= b or y0 >= d for a, b, c, d in self.taken)

    def anything(self, g: Generator) -> Model:
        """One of the theme's models."""
        weights = np.array([weight for weight, _ in self.theme.at_walls])
        chosen = g.choice(len(weights), p=weights / weights.sum())
        return self.theme.at_walls[chosen][1](g)


def build_room(g: Generator) -> Room:
    """Everything of one room; the randomness of `g` alone."""
    weights = np.array([theme.weight for theme in THEMES])
    theme = THEMES[g.choice(len(THEMES), p=weights / weights.sum())]
    width, depth = (between(g, *side) for side in theme.sides)
    height = between(g, 2.3, 2.9) + 0.5 * chance(g, 0.15)
    # people photograph a room from its edges
    share = 0.5 + 0.5 * g.choice([-1, 1], 2) * g.random(2) ** 0.5
    margin = FREE_RADIUS
    eye = (
        margin + float(share[0]) * (width - 2 * margin),
        margin + float(share[1]) * (depth - 2 * margin),
    )
    ambient = between(g, 0.04, 0.3) * (1.0 + g.uniform(-0.12, 0.12, 3))
    room = Room(theme, width, depth, height, eye, ambient)
    room.taken.append((eye[0] - margin, eye[1] - margin, eye[0] + margin, eye[1] + margin))
    _shell(g, room)
    if chance(g, theme.rows):
        _rows(g, room)
    elif chance(g, theme.group):
        _group_in_the_middle(g, room)
    _along_walls(g, room)
    _away_from_walls(g, room)
    _about_the_floor(g, room)
    add_lamps(g, room.parts, room.lights, (width, depth, height))
    return room


def _shell(g: Generator, room: Room) -> None:
    """Floor, ceiling, four walls with openings and things on them, blocks, a rug."""
    room.parts += [
        slab(room.width, room.depth, -0.1, 0.0, made_of.floor(g)),
        slab(room.width, room.depth, room.height, room.height + 0.1, made_of.ceiling(g)),
    ]
    common = made_of.wall_tiles(g) if chance(g, room.theme.tiled) else made_of.paint(g)
    board = made_of.wood(g)
    foot = made_of.paint(g) if chance(g, 0.12) else None
    windowed = g.permutation(4)[: int(g.integers(0, 3))]
    for index, wall in enumerate(room_walls(room.width, room.depth, room.height)):
        paint = common if chance(g, 0.75) else made_of.paint(g)
        holes = _openings(g, room, wall, windowed=index in windowed)
        parts: list[Part] = [(wall_mesh(wall.length, wall.height, holes), paint)]
        skirting = cladding(wall.length, holes, between(g, 0.05, 0.14), 0.015)
        if skirting is not None and chance(g, 0.7):
            parts.append((skirting, board))
        painted = cladding(wall.length, holes, between(g, 0.8, 1.1), 0.003)
        if painted is not None and foot is not None:
            parts.append((painted, foot))
        room.parts += wall.place(parts)
    if chance(g, 0.45):
        _block(g, room, common)
    if chance(g, 0.1):
        _slope(g, room, common)
    elif chance(g, 0.12):
        for y in np.arange(between(g, 0.2, 0.8), room.depth, between(g, 0.6, 1.2)):
            beam = box([0, y, room.height - 0.18], [room.width, y + 0.12, room.height])
            room.parts.append((beam, board))
    if chance(g, 0.45):
        _rug(g, room)


def _openings(g: Generator, room: Room, wall: Wall, *, windowed: bool) -> list[Opening]:
    """Puts windows, doors, passages and hangings along a wall; returns the holes they need."""
    holes: list[Opening] = []
    parts: list[Part] = []
    daylight = between(g, 0.6, 5.0)
    x = between(g, 0.15, 0.8)
    while x < wall.length - 0.9:
        w = between(g, 0.75, 0.95)
        if windowed and chance(g, 0.75):
            w = min(between(g, 0.6, 2.4), wall.length - x - 0.15)
            low = 0.05 if chance(g, 0.15) else between(g, 0.6, 1.1)
            hole = Opening(x, x + w, low, between(g, 1.9, min(2.4, wall.height - 0.1)))
            holes.append(hole)
            parts += window(g, hole, daylight)
            room.lights.append(window_light(g, wall, hole, daylight))
            if room.sun is None and chance(g, 0.35):
                room.sun = sunshine(g, wall, daylight)
        elif chance(g, 0.4):
            passage = chance(g, 0.25)
            w = min(between(g, 0.9, 2.2), wall.length - x - 0.15) if passage else w
            hole = Opening(x, x + w, 0.0, between(g, 1.95, 2.1))
            holes.append(hole)
            open_ = not passage and chance(g, 0.35)
            if not passage:
                parts += door(g, hole, open_=open_)
            if open_ or passage:
                contents = [room.anything(g) for _ in range(int(g.integers(0, 3)))]
                parts += other_room(g, hole, wall.height, contents)
            corners = [wall.to_world([hole.x0, 0, 0]), wall.to_world([hole.x1, w, 0])]
            a, b = np.minimum(*corners), np.maximum(*corners)
            room.taken.append((a[0], a[1], b[0], b[1]))
        elif chance(g, 0.6):
            parts += on_wall(g, x + w / 2, w)
        x += w + between(g, 0.25, 1.0)
    room.parts += wall.place(parts)
    return holes


def _block(g: Generator, room: Room, material: Material) -> None:
    """A column, chimney, half wall or set-back corner: edges that stand out."""
    w, d = between(g, 0.2, 0.4 * room.width), between(g, 0.2, 0.35 * room.depth)
    x = float(g.choice([0.0, room.width - w, between(g, 0, room.width - w)]))
    y = float(g.choice([0.0, room.depth - d]))
    if not room.fits((x, y, x + w, y + d)):
        return
    top = room.height if chance(g, 0.8) else between(g, 0.9, 1.3)
    if chance(g, 0.2):  # a wall across the corner
        side = max(w, d)
        block = box([-side, -side / 2, 0], [side, side / 2, top])
        corner = [0.0 if x < room.width / 2 else room.width, 0.0 if y == 0 else room.depth, 0.0]
        slant = np.pi / 4 if (corner[0] == 0) != (corner[1] == 0) else -np.pi / 4
        room.parts.append((block.moved(corner, slant), material))
        return
    room.parts.append((box([x, y, 0], [x + w, y + d, top]), material))
    room.taken.append((x, y, x + w, y + d))


def _slope(g: Generator, room: Room, material: Material) -> None:
    """A slanting roof along one side."""
    low, reach = between(g, 0.9, 1.8), between(g, 0.5, 0.6 * room.width)
    x = np.array([0.0, reach]) if chance(g, 0.5) else np.array([room.width, room.width - reach])
    y = np.array([0.0, room.depth])[:, None]
    z = np.array([low, room.height + 0.01])
    room.parts.append((sheet(np.stack([x + 0 * y, y + 0 * x, z + 0 * y], axis=-1)), material))


def _rug(g: Generator, room: Room) -> None:
    w, d = between(g, 0.8, 0.8 * room.width), between(g, 0.8, 0.7 * room.depth)
    place = [between(g, 0.3, 0.7) * room.width, between(g, 0.3, 0.7) * room.depth, 0.008]
    room.parts.append((flat_panel(w, d).moved(place, between(g, -0.2, 0.2)), made_of.carpet(g)))


def _put(g: Generator, room: Room, model: Model, position: tuple[float, float], yaw: float) -> bool:
    """Stands the model in the room, with clutter on it, if it fits."""
    w, d, _ = model.size
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.array([[-w / 2, 0], [w / 2, 0], [-w / 2, d], [w / 2, d]]) @ np.array(
        [[c, s], [-s, c]]
    )
    (x0, y0), (x1, y1) = corners.min(axis=0) + position, corners.max(axis=0) + position
    if not room.fits((x0, y0, x1, y1)):
        return False
    room.taken.append((x0, y0, x1, y1))
    density = between(g, 0.0, 6.0)
    things = [part for shelf in model.shelves for part in clutter(g, shelf, density)]
    whole = Model((*model.parts, *things), model.size)
    room.parts += whole.moved([*position, 0.0], yaw)
    for x, y, z in model.bulbs:
        place = np.array([position[0] + c * x - s * y, position[1] + s * x + c * y, z])
        room.lights.append(bulb(place, between(g, 0.4, 1.5) * np.array([1.0, 0.8, 0.55])))
    return True


def _along_walls(g: Generator, room: Room) -> None:
    walls = room_walls(room.width, room.depth, room.height)
    tries = room.theme.density * 2 * (room.width + room.depth) * between(g, 0.5, 1.2)
    for _ in range(int(tries)):
        model = room.anything(g)
        wall = walls[g.integers(4)]
        half = model.size[0] / 2
        if wall.length < 2 * half or model.size[2] > room.height:
            continue
        place = wall.to_world([between(g, half, wall.length - half), between(g, 0.0, 0.06), 0.0])
        _put(g, room, model, (float(place[0]), float(place[1])), wall.yaw)


def _away_from_walls(g: Generator, room: Room) -> None:
    """A sofa before a television, a kitchen island, racks of a shop."""
    for _ in range(int(g.poisson(0.25 * room.theme.density * room.width * room.depth / 10))):
        place = (between(g, 0, room.width), between(g, 0, room.depth))
        yaw = float(g.integers(4)) * np.pi / 2 + between(g, -0.1, 0.1)
        _put(g, room, room.anything(g), place, yaw)


def _alike(g: Generator, make: Make) -> Make:
    """The maker of ever the same model, as the chairs of one table are."""
    seed = int(g.integers(2**31))
    return lambda _: make(np.random.default_rng(seed))


def _group_in_the_middle(g: Generator, room: Room) -> None:
    """A table with chairs around it."""
    table = tables.table(g)
    w, d, h = table.size
    centre = np.array([between(g, 0.35, 0.65) * room.width, between(g, 0.35, 0.65) * room.depth])
    yaw = float(g.integers(0, 4)) * np.pi / 2 + between(g, -0.15, 0.15)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    back = centre + turn @ [0, -d / 2]
    if not _put(g, room, table, (float(back[0]), float(back[1])), yaw) or h < 0.6:
        return
    chair = _alike(g, seating.office_chair if chance(g, 0.2) else seating.chair)
    n = max(1, int(w / 0.65))
    along = (np.arange(n) + 0.5) / n * w - w / 2
    sides = [(x, d / 2, np.pi) for x in along] + [(x, -d / 2, 0.0) for x in along]
    sides += [(w / 2, 0.0, np.pi / 2), (-w / 2, 0.0, -np.pi / 2)]
    for x, y, facing in sides:
        if chance(g, 0.25):
            continue
        model = chair(g)
        gap = between(g, -0.15, 0.3) + model.size[1]
        out = np.array([0.0, np.sign(y)]) if y else np.array([np.sign(x), 0.0])
        place = centre + turn @ (np.array([x, y]) + gap * out)
        room.parts += model.moved([*place, 0.0], yaw + facing + between(g, -0.3, 0.3))


def _rows(g: Generator, room: Room) -> None:
    """Desks in rows, each with a chair."""
    make = _alike(g, tables.desk if chance(g, 0.6) else tables.table)
    chair = _alike(g, seating.office_chair if chance(g, 0.5) else seating.chair)
    w, d, _ = make(g).size
    for x in np.arange(0.3 + w / 2, room.width - w / 2, w + between(g, 0.1, 0.8)):
        for y in np.arange(0.5, room.depth - d - 1.0, d + between(g, 0.9, 1.4)):
            if _put(g, room, make(g), (float(x), float(y)), 0.0):
                seat = chair(g)
                place = [x, y + d + seat.size[1] + between(g, -0.2, 0.1), 0.0]
                room.parts += seat.moved(place, np.pi + between(g, -0.4, 0.4))


def _about_the_floor(g: Generator, room: Room) -> None:
    for _ in range(int(g.poisson(between(g, 0, 0.7) * room.width * room.depth))):
        make = floor_thing if chance(g, 0.85) else seating.chair
        place = (between(g, 0, room.width), between(g, 0, room.depth))
        _put(g, room, make(g), place, between(g, 0, 2 * np.pi))
