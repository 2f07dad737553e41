"""A model: meshes with materials, standing on the floor or on another model."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rooms.materials import Material
from rooms.mesh import Mesh, Point

Part = tuple[Mesh, Material]
Vector = Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Shelf:
    """A horizontal place for small things: a rectangle at height z with free space above [m]."""

    x0: float
    y0: float
    x1: float
    y1: float
    z: float
    clearance: float


@dataclass(frozen=True)
class Light:
    """A rectangular light, or with a zero normal one that shines in all directions.

    centre, half_u, half_v: [m]. power: RGB intensity.
    """

    centre: Vector
    half_u: Vector
    half_v: Vector
    normal: Vector
    power: Vector


@dataclass(frozen=True)
class Sun:
    """direction: unit, towards the sun. power: RGB irradiance."""

    direction: Vector
    power: Vector


@dataclass(frozen=True)
class Model:
    """An object in its own frame: back at y = 0, front towards +y, centred in x, bottom at z = 0.

    size: width (x), depth (y), height (z) [m]. shelves: where small things may stand. bulbs:
    points that shine.
    """

    parts: tuple[Part, ...]
    size: tuple[float, float, float]
    shelves: tuple[Shelf, ...] = ()
    bulbs: tuple[tuple[float, float, float], ...] = ()

    def moved(self, position: Point, yaw: float) -> list[Part]:
        """Its parts in the world."""
        return [(mesh.moved(position, yaw), material) for mesh, material in self.parts]


def chance(generator: np.random.Generator, probability: float) -> bool:
    """True with the given probability."""
    return bool(generator.random() < probability)


def between(generator: np.random.Generator, low: float, high: float) -> float:
    """Uniform in low..high."""
    return float(generator.uniform(low, high))
