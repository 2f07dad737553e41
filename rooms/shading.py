"""Light in a room: soft shadows, sunshine, one diffuse bounce, highlights, mirrors.

Each pixel takes one shadow ray a light and one bounce ray, out of a set that repeats every few
pixels; an average over so many pixels of one surface then holds the whole set (interleaved
sampling, Keller and Heidrich 2001). 16 shadow rays are shared by 4x4 pixels, 256 bounce rays by
16x16.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from rooms.models import Light, Sun
from rooms.raycast import Hits, Scalars, Surface, Vectors, World
from rooms.vectors import cross, dot, unit

_TILE = 4
_OFFSET = 2e-3  # rays start this far from surfaces [m]
_SUN_RADIUS = 0.008  # [rad], wider than the real one, as through hazy glass

Layers = Float32[np.ndarray, "layers height width"]


@dataclass(frozen=True)
class Lighting:
    """The lights of a room, the sun if it shines in, and the ambient radiance (RGB)."""

    lights: tuple[Light, ...]
    sun: Sun | None
    ambient: Float32[np.ndarray, "3"]


def lighting_of(
    lights: Sequence[Light], sun: Sun | None, ambient: Float[np.ndarray, "3"]
) -> Lighting:
    """The three strongest lights; further ones join the ambient light."""
    ranked = sorted(lights, key=lambda light: -float(light.power.sum()))
    rest = sum((0.05 * light.power for light in ranked[3:]), np.zeros(3))
    return Lighting(tuple(ranked[:3]), sun, (ambient + rest).astype(np.float32))


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
    origins = surface.point + _OFFSET * surface.facing
    pattern = _pattern(shape)
    shadows = [
        _visibility(world, light, surface, origins, pattern, generator) for light in lighting.lights
    ]
    shadows.append(_sunshine(world, lighting.sun, surface, origins, pattern, generator))
    bounce = _bounce(world, lighting, surface, origins, shape, generator).T
    facet = surface.facet.reshape(shape)
    noisy = np.concatenate([np.stack(shadows), bounce]).reshape(-1, *shape)
    smooth = _average(noisy, facet, stride=1)
    irradiance = _average(smooth[-3:], facet, stride=_TILE).reshape(3, -1).T
    *visible, sunlit = smooth[:-3].reshape(len(shadows), -1, 1)

    view = unit(directions)
    shininess = world.shininess[surface.material]
    highlight = np.zeros_like(irradiance)
    for light, seen in zip(lighting.lights, visible, strict=True):
        to_light, strength = _unshadowed(light, surface.point, surface.normal)
        arriving = seen * strength[:, None] * light.power.astype(np.float32)
        irradiance += arriving
        lobe = np.maximum(dot(unit(to_light - view), surface.normal), 0.0)
        highlight += arriving * (shininess * _power40(lobe))[:, None]
    if lighting.sun is not None:
        irradiance += sunlit * lighting.sun.power.astype(np.float32)
    emission = world.emission[surface.material][:, None]
    radiance = surface.albedo * np.where(emission > 0, emission, irradiance) + highlight
    return _add_mirrors(world, lighting, surface, radiance, view)


def _power40(x: Scalars) -> Scalars:
    """x ** 40 by repeated squaring, a highlight of medium width."""
    x8 = ((x * x) ** 2) ** 2
    result: Scalars = x8 * ((x8 * x8) ** 2)
    return result


def _pattern(shape: tuple[int, int]) -> Int[np.ndarray, " n"]:
    """Which of the 16 samples each pixel takes."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.ravel((y % _TILE) * _TILE + x % _TILE)


def _strata(generator: np.random.Generator) -> Float32[np.ndarray, "16 2"]:
    """One jittered point in each cell of a 4x4 grid over 0..1, shuffled."""
    cell = np.stack(np.divmod(generator.permutation(_TILE**2), _TILE), axis=1)
    points: Float32[np.ndarray, "16 2"] = (cell + generator.random((_TILE**2, 2))) / _TILE
    return points.astype(np.float32)


def _unshadowed(light: Light, points: Vectors, normals: Vectors) -> tuple[Vectors, Scalars]:
    """Direction to the light's centre, and irradiance without shadow for power 1."""
    to_light = light.centre.astype(np.float32) - points
    squared = dot(to_light, to_light)
    to_light = to_light / np.sqrt(squared)[:, None]
    strength = np.maximum(dot(to_light, normals), 0.0) / (squared + np.float32(0.1))
    if light.normal.any():
        strength = strength * np.maximum(-(to_light @ light.normal.astype(np.float32)), 0.0)
    return to_light, strength


def _visibility(
    world: World,
    light: Light,
    surface: Surface,
    origins: Vectors,
    pattern: Int[np.ndarray, " n"],
    generator: np.random.Generator,
) -> Scalars:
    """1 where the pixel's sample point on the light is seen, else 0."""
    across = 2 * _strata(generator) - 1
    points = light.centre + across[:, :1] * light.half_u + across[:, 1:] * light.half_v
    to_light = points.astype(np.float32)[pattern] - origins
    seen = dot(to_light, surface.normal) > 0
    ahead = np.flatnonzero(seen)
    reach = np.full(len(ahead), 0.99, np.float32)
    seen[ahead] = ~world.blocked(origins[ahead], to_light[ahead], reach)
    return seen.astype(np.float32)


def _sunshine(
    world: World,
    sun: Sun | None,
    surface: Surface,
    origins: Vectors,
    pattern: Int[np.ndarray, " n"],
    generator: np.random.Generator,
) -> Scalars:
    """Cosine of the sun's incidence where it is seen through a pane, else 0."""
    cosine = np.zeros(len(origins), dtype=np.float32)
    if sun is None:
        return cosine
    jitter = _SUN_RADIUS * (2 * _strata(generator) - 1)
    across, up = np.array([-sun.direction[1], sun.direction[0], 0.0]), np.array([0.0, 0.0, 1.0])
    towards = sun.direction + jitter[:, :1] * across + jitter[:, 1:] * up
    lit = np.flatnonzero(surface.normal @ sun.direction.astype(np.float32) > 0)
    hits = world.cast(origins[lit], towards.astype(np.float32)[pattern[lit]])
    through = world.backdrop[world.material_of(hits)]
    cosine[lit] = through * (surface.normal[lit] @ sun.direction.astype(np.float32))
    return cosine


def _bounce(
    world: World,
    lighting: Lighting,
    surface: Surface,
    origins: Vectors,
    shape: tuple[int, int],
    generator: np.random.Generator,
) -> Vectors:
    """Irradiance from other surfaces: one ray, cosine-distributed about the normal."""
    # each 4x4 block holds all 16 coarse cells of the hemisphere, each of 4x4 blocks another
    # part of every cell
    coarse, fine = _strata(generator), _strata(generator)
    y, x = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    block = (y // _TILE % _TILE) * _TILE + x // _TILE % _TILE
    cell = np.floor(coarse * _TILE)[_pattern(shape)]
    a, b = ((cell + fine[block]) / _TILE).T
    ring, angle = np.sqrt(a), 2 * np.pi * b
    normal = surface.normal
    side = np.stack([1e-4 - normal[:, 1], normal[:, 0], np.zeros_like(ring)], axis=1)
    side = unit(side)
    directions = (
        (ring * np.cos(angle))[:, None] * side
        + (ring * np.sin(angle))[:, None] * cross(normal, side)
        + np.sqrt(1 - a)[:, None] * normal
    ).astype(np.float32)
    hits = world.cast(origins, directions)
    return _dim_radiance(world, lighting, world.plain_surface(hits, origins, directions), hits)


def _dim_radiance(world: World, lighting: Lighting, surface: Surface, hits: Hits) -> Vectors:
    """Radiance of surfaces, without shadows and further bounces. Misses give ambient light."""
    irradiance = np.tile(lighting.ambient, (len(surface.point), 1))
    for light in lighting.lights:
        _, strength = _unshadowed(light, surface.point, surface.normal)
        # about half of the surfaces that face a light are in shadow
        irradiance += strength[:, None] * (0.5 * light.power).astype(np.float32)
    emission = world.emission[surface.material][:, None]
    radiance = surface.albedo * np.where(emission > 0, np.minimum(emission, 1.0), irradiance)
    return np.where((hits.triangle >= 0)[:, None], radiance, lighting.ambient)


def _add_mirrors(
    world: World, lighting: Lighting, surface: Surface, radiance: Vectors, view: Vectors
) -> Vectors:
    """Adds what is reflected, more at grazing angles (Schlick)."""
    base = world.mirror[surface.material]
    cosine = -dot(surface.normal, view)
    share = base + np.float32(0.5) * (base > 0) * (1 - np.clip(cosine, 0, 1)) ** 5
    chosen = np.flatnonzero(share > 0.035)
    if len(chosen) == 0:
        return radiance
    share, cosine = share[chosen], cosine[chosen]
    normal, direction = surface.normal[chosen], view[chosen]
    reflected = direction + 2 * cosine[:, None] * normal
    origins = surface.point[chosen] + _OFFSET * surface.facing[chosen]
    hits = world.cast(origins, reflected)
    light = _dim_radiance(
        world, lighting, world.surface(hits, origins, reflected, spread=0.006), hits
    )
    radiance[chosen] = radiance[chosen] * (1 - share)[:, None] + light * share[:, None]
    return radiance


def _average(values: Layers, facet: Int[np.ndarray, "height width"], *, stride: int) -> Layers:
    """Mean over 4x4 pixels, `stride` apart, of the same facet."""
    height, width = facet.shape
    before, after = stride * (_TILE // 2), stride * (_TILE - _TILE // 2 - 1)
    ring = ((before, after), (before, after))
    keys = np.pad(facet, ring, constant_values=-1)
    padded = np.pad(values, ((0, 0), *ring))
    total = np.zeros_like(values)
    count = np.zeros((height, width), dtype=np.float32)
    for dy in range(0, _TILE * stride, stride):
        for dx in range(0, _TILE * stride, stride):
            same = (keys[dy : dy + height, dx : dx + width] == facet).astype(np.float32)
            count += same
            total += padded[:, dy : dy + height, dx : dx + width] * same
    return total / count
