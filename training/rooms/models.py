"""A model: meshes with materials, standing on the floor or on another model."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from training.rooms.materials import Material
from training.rooms.mesh import Mesh, Point

Part = tuple[Mesh, Material]


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
class Model:
    """An object in its own frame: back at y = 0, front towards +y, centred in x, bottom at z = 0.

    size: width (x), depth (y), height (z) [m]. shelves: where small things may stand.
    """

    parts: tuple[Part, ...]
    size: tuple[float, float, float]
    shelves: tuple[Shelf, ...] = ()

    def moved(self, position: Point, yaw: float) -> list[Part]:
        """Its parts in the world."""
        return [(mesh.moved(position, yaw), material) for mesh, material in self.parts]


def stand_on(model: Model, things: Iterable[tuple[Model, Point, float]]) -> Model:
    """The model with other models put at positions and yaws in its frame."""
    parts = list(model.parts)
    for thing, position, yaw in things:
        parts += thing.moved(position, yaw)
    return Model(tuple(parts), model.size, model.shelves)


def chance(generator: np.random.Generator, probability: float) -> bool:
    """True with the given probability."""
    return bool(generator.random() < probability)


def between(generator: np.random.Generator, low: float, high: float) -> float:
    """Uniform in low..high."""
    return float(generator.uniform(low, high))
