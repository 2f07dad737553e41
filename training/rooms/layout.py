"""A random room: its shell, furniture, clutter and lights."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from training.rooms import furniture
from training.rooms import materials as made_of
from training.rooms.clutter import clutter, floor_thing
from training.rooms.materials import Generator
from training.rooms.mesh import box, lathe, panel, pillow, rods
from training.rooms.models import Model, Part, between, chance
from training.rooms.shell import (
    Light,
    Opening,
    Wall,
    door,
    on_wall,
    other_room,
    room_walls,
    skirting,
    slab,
    wall_mesh,
    window,
)

Rectangle = tuple[float, float, float, float]  # x0, y0, x1, y1 [m]

_AT_WALLS: tuple[tuple[float, Callable[[Generator], Model]], ...] = (
    (2.0, furniture.bookshelf), (1.5, furniture.dresser), (1.2, furniture.wardrobe),
    (1.6, furniture.sofa), (1.5, furniture.bed), (1.3, furniture.desk), (0.8, furniture.kitchen),
    (0.8, furniture.tv_stand), (0.8, furniture.plant), (0.6, furniture.floor_lamp),
    (0.8, furniture.table), (0.8, furniture.chair), (0.8, floor_thing),
)  # fmt: skip


@dataclass
class Room:
    """A room under construction, 0..width by 0..depth [m], and what stands in it.

    eye: where the camera stands; its surroundings stay free.
    """

    width: float
    depth: float
    height: float
    eye: tuple[float, float]
    ambient: Float[np.ndarray, "3"]
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    taken: list[Rectangle] = field(default_factory=list)

    def fits(self, rectangle: Rectangle) -> bool:
        """True if the rectangle is inside the room and hits nothing that stands there."""
        x0, y0, x1, y1 = rectangle
        if x0 < -0.01 or y0 < -0.01 or x1 > self.width + 0.01 or y1 > self.depth + 0.01:
            return False
        return all(x1 <= a or x0 >= c or y1 <= b or y0 >= d for a, b, c, d in self.taken)


def build_room(g: Generator) -> Room:
    """Everything of one room; the randomness of `g` alone."""
    corridor = chance(g, 0.15)
    if corridor:
        width, depth = between(g, 1.3, 2.4), between(g, 4.0, 9.5)
    else:
        width, depth = between(g, 2.4, 6.5), between(g, 2.6, 7.0)
    tint = 1.0 + g.uniform(-0.12, 0.12, 3)
    eye = (between(g, 0.35, width - 0.35), between(g, 0.35, depth - 0.35))
    room = Room(width, depth, between(g, 2.3, 3.1), eye, between(g, 0.1, 0.5) * tint)
    reach = 0.35
    room.taken.append((eye[0] - reach, eye[1] - reach, eye[0] + reach, eye[1] + reach))
    _shell(g, room)
    if not corridor and chance(g, 0.35):
        _group_in_the_middle(g, room)
    _along_walls(g, room, tries=6 if corridor else 18)
    _about_the_floor(g, room)
    _lamps(g, room)
    return room


def _shell(g: Generator, room: Room) -> None:
    """Floor, ceiling, four walls with openings and things on them, columns, a rug."""
    room.parts += [
        slab(room.width, room.depth, -0.1, 0.0, made_of.floor(g)),
        slab(room.width, room.depth, room.height, room.height + 0.1, made_of.ceiling(g)),
    ]
    walls = room_walls(room.width, room.depth, room.height)
    common, board = made_of.paint(g), made_of.wood(g)
    windowed = g.permutation(4)[: int(g.integers(0, 3))]
    for index, wall in enumerate(walls):
        paint = common if chance(g, 0.75) else made_of.paint(g)
        _wall(g, room, wall, paint=paint, board=board, windowed=index in windowed)
    if chance(g, 0.45):  # a block in a corner or at a wall: corners that stand out
        w, d = between(g, 0.2, 0.4 * room.width), between(g, 0.2, 0.35 * room.depth)
        x = float(g.choice([0.0, room.width - w, between(g, 0, room.width - w)]))
        y = float(g.choice([0.0, room.depth - d]))
        if room.fits((x, y, x + w, y + d)):
            top = room.height if chance(g, 0.8) else between(g, 0.9, 1.3)
            room.parts.append((box([x, y, 0], [x + w, y + d, top]), common))
            room.taken.append((x, y, x + w, y + d))
    if chance(g, 0.15):  # beams
        for y in np.arange(between(g, 0.2, 0.8), room.depth, between(g, 0.6, 1.2)):
            beam = box([0, y, room.height - 0.18], [room.width, y + 0.12, room.height])
            room.parts.append((beam, board))
    if chance(g, 0.5):
        _rug(g, room)


def _rug(g: Generator, room: Room) -> None:
    w, d = between(g, 0.8, 0.8 * room.width), between(g, 0.8, 0.7 * room.depth)
    flat = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    rug = panel([-w / 2, 0, -d / 2], [w / 2, 0, d / 2]).turned(flat)
    place = [between(g, 0.3, 0.7) * room.width, between(g, 0.3, 0.7) * room.depth, 0.008]
    room.parts.append((rug.moved(place, between(g, -0.2, 0.2)), made_of.carpet(g)))


def _wall(
    g: Generator,
    room: Room,
    wall: Wall,
    *,
    paint: made_of.Material,
    board: made_of.Material,
    windowed: bool,
) -> None:
    """One wall with its openings; windows also give a light."""
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
            room.lights.append(_window_light(g, wall, hole, daylight))
        elif chance(g, 0.35):
            hole = Opening(x, x + w, 0.0, between(g, 1.95, 2.1))
            holes.append(hole)
            open_ = chance(g, 0.4)
            parts += door(g, hole, open_=open_)
            if open_:
                parts += other_room(g, hole, wall.height)
            foot = [wall.to_world([hole.x0, 0, 0]), wall.to_world([hole.x1, w, 0])]
            low_, high_ = np.minimum(*foot), np.maximum(*foot)
            room.taken.append((low_[0], low_[1], high_[0], high_[1]))
        elif chance(g, 0.5):
            parts += on_wall(g, x + w / 2, between(g, 1.3, 1.8))
        x += w + between(g, 0.25, 1.0)
    parts.append((wall_mesh(wall.length, wall.height, holes), paint))
    if chance(g, 0.7):
        parts.append((skirting(wall.length, holes, between(g, 0.05, 0.14)), board))
    room.parts += wall.place(parts)


def _window_light(g: Generator, wall: Wall, hole: Opening, daylight: float) -> Light:
    area = (hole.x1 - hole.x0) * (hole.z1 - hole.z0)
    centre = wall.to_world([(hole.x0 + hole.x1) / 2, 0.02, (hole.z0 + hole.z1) / 2])
    return Light(
        centre,
        wall.direction((hole.x1 - hole.x0) / 2, 0.0),
        np.array([0, 0, (hole.z1 - hole.z0) / 2]),
        wall.direction(0.0, 1.0),
        area * daylight * between(g, 0.3, 1.0) * np.array([0.9, 1.0, 1.12]),
    )


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
    density = between(g, 0.0, 5.0)
    things = [part for shelf in model.shelves for part in clutter(g, shelf, density)]
    whole = Model((*model.parts, *things), model.size)
    room.parts += whole.moved([*position, 0.0], yaw)
    return True


def _along_walls(g: Generator, room: Room, *, tries: int) -> None:
    walls = room_walls(room.width, room.depth, room.height)
    weights = np.array([weight for weight, _ in _AT_WALLS])
    for _ in range(int(g.integers(tries // 2, tries + 1))):
        model = _AT_WALLS[g.choice(len(_AT_WALLS), p=weights / weights.sum())][1](g)
        wall = walls[g.integers(4)]
        half = model.size[0] / 2
        if wall.length < 2 * half or model.size[2] > room.height:
            continue
        place = wall.to_world([between(g, half, wall.length - half), between(g, 0.0, 0.06), 0.0])
        _put(g, room, model, (float(place[0]), float(place[1])), wall.yaw)


def _group_in_the_middle(g: Generator, room: Room) -> None:
    """A table with chairs around it."""
    model = furniture.table(g)
    w, d, h = model.size
    centre = (between(g, 0.35, 0.65) * room.width, between(g, 0.35, 0.65) * room.depth)
    yaw = float(g.integers(0, 4)) * np.pi / 2 + between(g, -0.15, 0.15)
    c, s = np.cos(yaw), np.sin(yaw)
    if not _put(g, room, model, (centre[0] + s * d / 2, centre[1] - c * d / 2), yaw) or h < 0.6:
        return
    make = furniture.office_chair if chance(g, 0.2) else furniture.chair
    state = g.bit_generator.state
    sides = [
        (0.0, d / 2, np.pi),
        (0.0, -d / 2, 0.0),
        (w / 2, 0.0, np.pi / 2),
        (-w / 2, 0.0, -np.pi / 2),
    ]
    later = state
    for x, y, turn in sides:
        if chance(g, 0.25):
            continue
        later, g.bit_generator.state = g.bit_generator.state, state
        model = make(g)  # the chairs of one table are alike
        g.bit_generator.state = later
        gap = between(g, -0.15, 0.35)
        length = max(float(np.hypot(x, y)), 1e-6)
        out = 1 + (gap + model.size[1]) / length
        px, py = x * out, y * out
        place = [centre[0] + c * px - s * py, centre[1] + s * px + c * py, 0.0]
        room.parts += model.moved(place, yaw + turn + between(g, -0.3, 0.3))


def _about_the_floor(g: Generator, room: Room) -> None:
    for _ in range(int(g.poisson(between(g, 0, 12)))):
        make = floor_thing if chance(g, 0.85) else furniture.chair
        place = (between(g, 0, room.width), between(g, 0, room.depth))
        _put(g, room, make(g), place, between(g, 0, 2 * np.pi))


def _lamps(g: Generator, room: Room) -> None:
    """Ceiling lamps and lit standing lamps. A room without windows has at least one lit lamp."""
    warm = np.array([1.0, between(g, 0.72, 0.98), 0.0])
    warm[2] = between(g, 0.45, 0.95) * warm[1]
    lit = not room.lights or chance(g, 0.6)
    n = int(g.integers(1, 3)) if lit or chance(g, 0.7) else 0
    for _ in range(n):
        x, y = between(g, 0.2, 0.8) * room.width, between(g, 0.2, 0.8) * room.depth
        radiance = between(g, 1.5, 6.0) if lit else 0.0
        glow = made_of.emitter(warm.astype(np.float32), radiance) if lit else made_of.plastic(g)
        drop = _ceiling_lamp(g, room, (x, y), glow)
        if lit:
            side = between(g, 0.08, 0.3)
            room.lights.append(
                Light(
                    np.array([x, y, room.height - drop]),
                    np.array([side, 0, 0]),
                    np.array([0, side, 0]),
                    np.array([0.0, 0.0, -1.0]) if chance(g, 0.3) else np.zeros(3),
                    between(g, 1.0, 4.0) * warm,
                )
            )


def _ceiling_lamp(
    g: Generator, room: Room, place: tuple[float, float], glow: made_of.Material
) -> float:
    """Adds a lamp; returns how far below the ceiling its light starts [m]."""
    top = room.height
    x, y = place
    if chance(g, 0.35):  # flat panel or tube
        w, d = between(g, 0.1, 0.35), between(g, 0.3, 0.7)
        room.parts.append((box([x - w, y - d, top - 0.06], [x + w, y + d, top]), glow))
        return 0.08
    if chance(g, 0.5):  # dome
        dome = pillow([0.36, 0.36, 0.2], square=1.0).shifted([x, y, top])
        room.parts.append((dome, glow))
        return 0.14
    length = between(g, 0.3, 0.9)
    cord = rods(np.array([[x, y, top - length]]), np.array([[x, y, top]]), 0.006)
    shade = lathe([(0.2, 0), (between(g, 0.04, 0.2), 0.18)]).shifted([x, y, top - length - 0.1])
    bulb = pillow([0.09] * 3, square=1.0, resolution=8).shifted([x, y, top - length - 0.03])
    room.parts += [(cord, made_of.metal(g)), (shade, made_of.fabric(g)), (bulb, glow)]
    return length + 0.13
