"""Shading and photography of the room generator."""

from dataclasses import replace

import numpy as np
import pytest

from rooms import materials as made_of
from rooms.camera import Camera, intrinsics, look
from rooms.lamps import bulb
from rooms.mesh import box, panel
from rooms.models import Part, Sun
from rooms.photo import choose_film, photograph
from rooms.raycast import World
from rooms.shading import _average, lighting_of, shade

SHAPE = (24, 32)
AMBIENT = np.array([0.1, 0.1, 0.1])


def matt() -> made_of.Material:
    made = made_of.ceramic(np.random.default_rng(0))
    return replace(made, shininess=0.0, mirror=0.0)


def floor_from_above(parts: list[Part], sun: Sun | None, power: float) -> np.ndarray:
    """Radiance / albedo of what a camera 3 m above the origin sees, with a bulb beside it."""
    height, width = SHAPE
    camera = Camera(
        intrinsics(width, height, 1.0), look(0.0, -np.pi / 2, 0.0), np.array([0, 0, 3.0])
    )
    world = World(parts)
    origins, rays = camera.rays(width, height)
    surface = world.surface(world.cast(origins, rays), origins, rays, 1e-3)
    light = bulb(np.array([0.0, 0.0, 2.0]), np.full(3, power))
    lighting = lighting_of([light], sun, AMBIENT)
    generator = np.random.default_rng(0)
    radiance = shade(world, lighting, surface, rays, shape=SHAPE, generator=generator)
    irradiance: np.ndarray = (radiance / surface.albedo).mean(axis=1).reshape(SHAPE)
    return irradiance


FLOOR: Part = (box([-3, -3, -0.1], [3, 3, 0.0]), matt())


def test_an_open_floor_gets_the_inverse_square_of_its_lamp() -> None:
    irradiance = floor_from_above([FLOOR], None, power=2.0)
    # straight below the lamp; 0.1 m^2 keeps the irradiance finite at the lamp itself
    assert irradiance[12, 16] == pytest.approx(0.1 + 2.0 / (2.0**2 + 0.1), rel=0.02)
    assert irradiance[0, 0] < irradiance[12, 16]


def test_a_board_casts_a_shadow_and_its_surroundings_stay_lit() -> None:
    board: Part = (box([-0.3, 0.5, 0.8], [0.3, 0.9, 0.82]), matt())
    image = floor_from_above([FLOOR, board], None, power=2.0)
    open_floor = floor_from_above([FLOOR], None, power=2.0)
    ratio = image / open_floor
    assert (ratio < 0.6).any()
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)


def test_the_sun_shines_through_panes_only() -> None:
    sun = Sun(np.array([0.0, 0.6, 0.8]), np.full(3, 5.0))
    lit = floor_from_above([FLOOR], sun, power=0.0)
    np.testing.assert_allclose(lit, 0.1, rtol=0.05)  # no pane, no sun
    glass = made_of.window_pane(np.random.default_rng(0), 1.0)
    pane: Part = (panel([-3, 2.9, 0], [3, 2.9, 4]), glass)
    lit = floor_from_above([FLOOR, pane], sun, power=0.0)
    assert lit.max() > 0.1 + 5.0 * 0.8 * 0.95


def test_average_is_the_mean_of_the_same_facet() -> None:
    generator = np.random.default_rng(0)
    values = generator.random((2, 9, 11)).astype(np.float32)
    facet = generator.integers(0, 2, (9, 11))
    for stride in (1, 3):
        expected = np.empty_like(values)
        for y in range(9):
            for x in range(11):
                near = [
                    (y + dy * stride, x + dx * stride)
                    for dy in range(-2, 2)
                    for dx in range(-2, 2)
                    if 0 <= y + dy * stride < 9 and 0 <= x + dx * stride < 11
                ]
                same = [p for p in near if facet[p] == facet[y, x]]
                expected[:, y, x] = np.mean([values[:, *p] for p in same], axis=0)
        np.testing.assert_allclose(_average(values, facet, stride=stride), expected, rtol=1e-5)


def test_more_light_makes_a_brighter_picture() -> None:
    generator = np.random.default_rng(3)
    radiance = generator.random((24, 32, 3)).astype(np.float32)
    film = choose_film(radiance, generator)
    dark = photograph(radiance, replace(film, gain=film.gain * 0.5), np.random.default_rng(0))
    bright = photograph(radiance, replace(film, gain=film.gain * 2), np.random.default_rng(0))
    assert dark.mean() < bright.mean()
    again = photograph(radiance, replace(film, gain=film.gain * 2), np.random.default_rng(0))
    np.testing.assert_array_equal(bright, again)


def test_a_shaken_camera_blurs() -> None:
    generator = np.random.default_rng(3)
    radiance = np.zeros((48, 64, 3), dtype=np.float32)
    radiance[:, 32:] = 1.0
    film = replace(choose_film(radiance + 0.1, generator), grain=0.0, gain=np.ones(3), vignette=0.0)
    still = photograph(radiance, replace(film, shake=(0.0, 0.0)), generator)
    shaken = photograph(radiance, replace(film, shake=(15.0, 0.0)), generator)
    steepest = [np.abs(np.diff(image.astype(int), axis=1)).max() for image in (still, shaken)]
    assert steepest[1] < steepest[0]
