"""Light in a room: soft shadows, one diffuse bounce, highlights, mirrors.

Each pixel takes one shadow ray a light and one bounce ray, out of 16 that differ within 4x4
pixels; a 4x4 average within each surface then holds all 16 (interleaved sampling,
Keller and Heidrich 2001).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int

from training.rooms.raycast import Scalars, Surface, Vectors, World, unit
from training.rooms.shell import Light

_TILE = 4
_OFFSET = 2e-3  # rays start this far from surfaces [m]


@dataclass(frozen=True)
class Lighting:
    """The lights of a room and its ambient radiance, RGB."""

    lights: tuple[Light, ...]
    ambient: Float32[np.ndarray, "3"]


def shade(
    world: World,
    lighting: Lighting,
    surface: Surface,
    directions: Vectors,
    *,
    shape: tuple[int, int],
    generator: np.random.Generator,
) -> Vectors:
    """Linear radiance towards the viewer for the surfaces of a whole image."""
    pattern = _pattern(shape)
    origins = surface.point + _OFFSET * surface.facing
    layers = [
        _visibility(world, light, origins, pattern, generator).reshape(*shape, 1)
        for light in lighting.lights
    ]
    bounce = _bounce(world, lighting, surface, origins, pattern, generator)
    noisy = np.concatenate([*layers, bounce.reshape(*shape, 3)], axis=2)
    smooth = _average(noisy, surface.facet.reshape(shape)).reshape(len(origins), -1)
    emission = world.emission[surface.material][:, None]
    shininess = world.shininess[surface.material]
    view = unit(directions)
    irradiance = smooth[:, -3:]
    highlight = np.zeros_like(irradiance)
    for index, light in enumerate(lighting.lights):
        to_light, strength = _unshadowed(light, surface.point, surface.normal)
        seen = smooth[:, index, None] * light.power.astype(np.float32)
        irradiance += seen * strength[:, None]
        half = unit(to_light - view)
        lobe = np.maximum(np.einsum("ij,ij->i", half, surface.normal), 0.0)
        highlight += seen * (shininess * strength * _power32(lobe))[:, None]
    radiance = surface.albedo * np.where(emission > 0, emission, irradiance) + highlight
    return _add_mirrors(world, lighting, surface, radiance, view)


def _power32(x: Scalars) -> Scalars:
    """x ** 40 by repeated squaring, a highlight of medium width."""
    x8 = ((x * x) ** 2) ** 2
    result: Scalars = x8 * ((x8 * x8) ** 2)
    return result


def _pattern(shape: tuple[int, int]) -> Int[np.ndarray, " n"]:
    """Which of the 16 samples each pixel takes."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return ((y % _TILE) * _TILE + x % _TILE).ravel()


def _strata(generator: np.random.Generator) -> Float32[np.ndarray, "16 2"]:
    """One jittered point in each cell of a 4x4 grid over 0..1, shuffled."""
    cell = np.stack(np.divmod(generator.permutation(_TILE**2), _TILE), axis=1)
    points: Float32[np.ndarray, "16 2"] = (cell + generator.random((_TILE**2, 2))) / _TILE
    return points.astype(np.float32)


def _unshadowed(light: Light, points: Vectors, normals: Vectors) -> tuple[Vectors, Scalars]:
    """Direction to the light's centre, and irradiance without shadow for power 1."""
    to_light = light.centre.astype(np.float32) - points
    squared = np.einsum("ij,ij->i", to_light, to_light)
    to_light = to_light / np.sqrt(squared)[:, None]
    strength = np.maximum(np.einsum("ij,ij->i", to_light, normals), 0.0) / (squared + 0.1)
    if light.normal.any():
        strength = strength * np.maximum(-(to_light @ light.normal.astype(np.float32)), 0.0)
    return to_light, strength


def _visibility(
    world: World,
    light: Light,
    origins: Vectors,
    pattern: Int[np.ndarray, " n"],
    generator: np.random.Generator,
) -> Scalars:
    """1 where the pixel's sample point on the light is seen, else 0."""
    across = 2 * _strata(generator) - 1
    points = light.centre + across[:, :1] * light.half_u + across[:, 1:] * light.half_v
    to_light = points.astype(np.float32)[pattern] - origins
    blocked = world.blocked(origins, to_light, np.full(len(origins), 0.99, np.float32))
    return (~blocked).astype(np.float32)


def _bounce(
    world: World,
    lighting: Lighting,
    surface: Surface,
    origins: Vectors,
    pattern: Int[np.ndarray, " n"],
    generator: np.random.Generator,
) -> Vectors:
    """Irradiance from other surfaces: one ray, cosine-distributed about the normal."""
    a, b = _strata(generator).T
    ring, angle = np.sqrt(a), 2 * np.pi * b
    local = np.stack([ring * np.cos(angle), ring * np.sin(angle), np.sqrt(1 - a)], axis=1)
    local = local.astype(np.float32)[pattern]
    side = np.stack(
        [-surface.normal[:, 1], surface.normal[:, 0], np.zeros_like(surface.normal[:, 0])], axis=1
    )
    side[:, 0] += 1e-4
    side = unit(side)
    other = np.cross(surface.normal, side)
    directions = local[:, :1] * side + local[:, 1:2] * other + local[:, 2:] * surface.normal
    return radiance_along(world, lighting, origins, directions.astype(np.float32), spread=1.0)


def radiance_along(
    world: World, lighting: Lighting, origins: Vectors, directions: Vectors, *, spread: float
) -> Vectors:
    """What rays bring back, without shadows and further bounces. Misses bring ambient light."""
    hits = world.cast(origins, directions)
    surface = world.surface(
        hits, origins, directions, np.full(len(origins), spread, dtype=np.float32)
    )
    irradiance = np.tile(lighting.ambient.astype(np.float32), (len(origins), 1))
    for light in lighting.lights:
        _, strength = _unshadowed(light, surface.point, surface.normal)
        # about half of the surfaces that face a light are in shadow
        irradiance += strength[:, None] * (0.5 * light.power).astype(np.float32)
    emission = world.emission[surface.material][:, None]
    radiance = surface.albedo * np.where(emission > 0, np.minimum(emission, 1.0), irradiance)
    return np.where((hits.triangle >= 0)[:, None], radiance, lighting.ambient.astype(np.float32))


def _add_mirrors(
    world: World, lighting: Lighting, surface: Surface, radiance: Vectors, view: Vectors
) -> Vectors:
    """Adds what is reflected, more at grazing angles (Schlick)."""
    base = world.mirror[surface.material]
    chosen = np.flatnonzero(base > 0.005)
    if len(chosen) == 0:
        return radiance
    normal, direction = surface.normal[chosen], view[chosen]
    cosine = -np.einsum("ij,ij->i", normal, direction)
    grazing = (1 - np.clip(cosine, 0, 1)) ** 5
    share = base[chosen] + (1 - base[chosen]) * grazing * 0.6
    reflected = direction + 2 * cosine[:, None] * normal
    origins = surface.point[chosen] + _OFFSET * surface.facing[chosen]
    light = radiance_along(world, lighting, origins, reflected, spread=0.006)
    radiance[chosen] = radiance[chosen] * (1 - share)[:, None] + light * share[:, None]
    return radiance


def _average(
    values: Float32[np.ndarray, "height width channels"], facet: Int[np.ndarray, "height width"]
) -> Float32[np.ndarray, "height width channels"]:
    """Mean over 4x4 pixels of the same facet; a window of this size holds every sample once."""
    height, width = facet.shape
    before, after = _TILE // 2, _TILE - _TILE // 2 - 1
    ring = ((before, after), (before, after))
    keys = np.pad(facet, ring, constant_values=-1)
    padded = np.pad(values, (*ring, (0, 0)))
    total = np.zeros_like(values)
    count = np.zeros((height, width, 1), dtype=np.float32)
    for dy in range(_TILE):
        for dx in range(_TILE):
            same = (keys[dy : dy + height, dx : dx + width] == facet)[..., None]
            total += padded[dy : dy + height, dx : dx + width] * same
            count += same
    return total / count


def lighting_of(lights: Sequence[Light], ambient: Float32[np.ndarray, "3"]) -> Lighting:
    """The three strongest lights; further ones join the ambient light."""
    ranked = sorted(lights, key=lambda light: -float(light.power.sum()))
    rest = sum((0.05 * light.power for light in ranked[3:]), np.zeros(3))
    return Lighting(tuple(ranked[:3]), (ambient + rest).astype(np.float32))
