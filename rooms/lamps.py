"""Where the light of a room comes from."""

import numpy as np
from jaxtyping import Float

from rooms import materials as made_of
from rooms.materials import Generator, Material
from rooms.mesh import box, lathe, pillow, rods
from rooms.models import Light, Part, Sun, between, chance
from rooms.shell import Opening, Wall


def bulb(place: Float[np.ndarray, "3"], power: Float[np.ndarray, "3"]) -> Light:
    """A small light that shines in all directions."""
    size = 0.05
    return Light(place, np.array([size, 0, 0]), np.array([0, size, 0]), np.zeros(3), power)


def window_light(g: Generator, wall: Wall, hole: Opening, daylight: float) -> Light:
    """The sky's light through a window."""
    w, h = hole.x1 - hole.x0, hole.z1 - hole.z0
    return Light(
        wall.to_world([(hole.x0 + hole.x1) / 2, 0.02, (hole.z0 + hole.z1) / 2]),
        wall.direction(w / 2, 0.0),
        np.array([0, 0, h / 2]),
        wall.direction(0.0, 1.0),
        w * h * daylight * between(g, 0.3, 1.0) * np.array([0.9, 1.0, 1.12]),
    )


def sunshine(g: Generator, wall: Wall, daylight: float) -> Sun:
    """A sun that shines through the windows of a wall."""
    height, aside = np.radians(between(g, 12, 55)), np.radians(between(g, -60, 60))
    level = wall.direction(np.sin(aside), -np.cos(aside)) * np.cos(height)
    power = daylight * between(g, 0.5, 2.0) * np.array([1.0, 0.93, 0.8])
    return Sun(level + np.array([0, 0, np.sin(height)]), power)


def add_lamps(
    g: Generator, parts: list[Part], lights: list[Light], size: tuple[float, float, float]
) -> None:
    """Ceiling lamps. A room without any other light has at least one that is lit."""
    width, depth, top = size
    warm = np.array([1.0, between(g, 0.72, 0.98), 0.0])
    warm[2] = between(g, 0.45, 0.95) * warm[1]
    lit = not lights or chance(g, 0.5)
    count = int(g.integers(1, 4)) if lit or chance(g, 0.7) else 0
    kind = int(g.integers(4))
    dimmed = made_of.plastic(g)
    for i in range(count):
        x = between(g, 0.2, 0.8) * width
        y = (i + between(g, 0.3, 0.7)) / count * depth
        radiance = between(g, 1.5, 6.0)
        glow = made_of.emitter(warm.astype(np.float32), radiance) if lit else dimmed
        shapes, drop = _ceiling_lamp(g, kind, glow)
        parts += [(mesh.shifted([x, y, top]), material) for mesh, material in shapes]
        if lit:
            power = between(g, 1.0, 4.0) / count**0.5 * warm
            side = between(g, 0.08, 0.3)
            down = np.array([0.0, 0.0, -1.0]) if kind < 2 else np.zeros(3)
            half_u, half_v = np.array([side, 0, 0]), np.array([0, side, 0])
            lights.append(Light(np.array([x, y, top - drop]), half_u, half_v, down, power))


def _ceiling_lamp(g: Generator, kind: int, glow: Material) -> tuple[list[Part], float]:
    """A lamp below the origin, and how far below its light starts [m]."""
    if kind == 0:  # flat panel or tube
        w, d = between(g, 0.1, 0.35), between(g, 0.3, 0.7)
        return [(box([-w, -d, -0.06], [w, d, 0]), glow)], 0.08
    if kind == 1:  # spot
        return [(lathe([(0, -0.015), (0.06, -0.015), (0.08, 0)], 16), glow)], 0.03
    if kind == 2:  # dome
        return [(pillow([0.36, 0.36, 0.2], square=1.0), glow)], 0.14
    length = between(g, 0.3, 0.9)
    cord = rods(np.array([[0, 0, -length]]), np.array([[0, 0, 0]]), 0.006)
    shade = lathe([(0.2, 0), (between(g, 0.04, 0.2), 0.18)]).shifted([0, 0, -length - 0.1])
    shining = pillow([0.09] * 3, square=1.0, resolution=8).shifted([0, 0, -length - 0.03])
    hanging: list[Part] = [(cord, made_of.metal(g)), (shade, made_of.fabric(g)), (shining, glow)]
    return hanging, length + 0.13
