"""Rendered RGB-D frames of random rooms, single ones and along a camera path; and of streets."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from rooms.camera import Camera, hand_held, intrinsics, look
from rooms.layout import Room, build_room
from rooms.photo import choose_film, photograph
from rooms.raycast import Surface, World
from rooms.shading import lighting_of, shade
from rooms.streets import Street, build_street

MAX_DEPTH_M = 10.0
MAX_STREET_DEPTH_M = 65.0

Picture = UInt8[np.ndarray, "height width 3"]


@dataclass(frozen=True, kw_only=True)
class RoomFrame:
    """A rendered frame; everything per pixel, aligned.

    image: RGB in 0..255. depth: metric, along the optical axis, [m], at most 10, on a street at
    most 65, or inf for the sky; mirrors and panes have the depth of their surface. K: intrinsics
    [px]. camera_to_world: rigid motion [m]. normals: unit, camera frame, towards the camera.
    albedo: linear RGB. shininess: 0..1. glass: True on panes and mirrors.
    """

    image: Picture
    depth: Float32[np.ndarray, "height width"]
    K: Float[np.ndarray, "3 3"]
    camera_to_world: Float[np.ndarray, "4 4"]
    normals: Float32[np.ndarray, "height width 3"]
    albedo: Float32[np.ndarray, "height width 3"]
    shininess: Float32[np.ndarray, "height width"]
    glass: Bool[np.ndarray, "height width"]


@dataclass(frozen=True)
class _Trace:
    """What rays found from a camera: before light becomes a picture."""

    camera: Camera
    surface: Surface
    depth: Float32[np.ndarray, "height width"]
    radiance: Float32[np.ndarray, "height width 3"]


def render_room(seed: int, *, width: int = 320, height: int = 240) -> RoomFrame:
    """A frame of the room, camera and photograph that `seed` (>= 0) stands for.

    The same seed at another size with the same aspect ratio shows the same view.
    """
    generator = np.random.default_rng(seed)
    room, world, camera = _room_with_view(generator, width / height)
    trace = _trace(room, world, camera.resized(width), height, generator=generator)
    film = choose_film(trace.radiance, generator)
    return _frame(world, trace, photograph(trace.radiance, film, generator))


def render_street(seed: int, *, width: int = 320, height: int = 240) -> RoomFrame:
    """A frame of the street, camera and photograph that `seed` (>= 0) stands for."""
    generator = np.random.default_rng(seed)
    while True:
        street = build_street(generator)
        world = World(street.parts)
        camera = _choose_street_camera(generator, street, world, width / height)
        if camera is not None:
            break
    trace = _trace(street, world, camera.resized(width), height, generator=generator)
    film = choose_film(trace.radiance, generator)
    return _frame(world, trace, photograph(trace.radiance, film, generator))


def camera_path(
    seed: int, frames: int, *, width: int = 320, height: int = 240
) -> Iterator[RoomFrame]:
    """Frames 1/30 s apart of a hand-held camera in one room, with one exposure.

    Geometry and light are still; the noise differs from frame to frame.
    """
    generator = np.random.default_rng(seed)
    room, world, camera = _room_with_view(generator, width / height)
    camera = camera.resized(width)
    light_seed = int(generator.integers(2**31))
    film = None
    for moved in hand_held(camera, frames, generator):
        steady = np.random.default_rng(light_seed)
        trace = _trace(room, world, moved, height, generator=steady)
        film = film or choose_film(trace.radiance, generator)
        yield _frame(world, trace, photograph(trace.radiance, film, generator))


def _room_with_view(generator: np.random.Generator, aspect: float) -> tuple[Room, World, Camera]:
    """The first random room with a usable view; a few have none, behind a column say."""
    while True:
        room = build_room(generator)
        world = World(room.parts)
        camera = _choose_camera(generator, room, world, aspect)
        if camera is not None:
            return room, world, camera


def _choose_camera(
    generator: np.random.Generator, room: Room, world: World, aspect: float
) -> Camera | None:
    """A hand-held view from the room's eye point: the richest of a few that see far enough."""
    width, height = 32, round(32 / aspect)
    best, best_score = None, 1.0  # less is a bare wall
    for _ in range(int(generator.integers(5, 16))):
        view_angle = np.radians(generator.triangular(45, 58, 90))
        pitch = np.radians(np.clip(generator.normal(-10, 9), -40, 15))
        roll = np.radians(generator.normal(0, 2.5))
        rotation = look(generator.uniform(0, 2 * np.pi), pitch, roll)
        eye = np.array([*room.eye, min(generator.uniform(0.7, 1.75), room.height - 0.3)])
        camera = Camera(intrinsics(width, height, view_angle), rotation, eye)
        origins, rays = camera.rays(width, height)
        hits = world.cast(origins, rays)
        depth = np.minimum(hits.distance, MAX_DEPTH_M)
        near = float(np.mean(depth < 0.7)) + float(np.median(depth) < 1.3)
        variety = len(np.unique(world.material_of(hits)))
        score = np.log(variety) + float(np.std(np.log(depth))) - 20 * near
        if score > best_score:
            best, best_score = camera, score
    return best


def _choose_street_camera(
    generator: np.random.Generator, street: Street, world: World, aspect: float
) -> Camera | None:
    """A view mostly along the street, from a car or a pavement, of which little is very near."""
    width, height = 32, round(32 / aspect)
    for _ in range(6):
        view_angle = np.radians(generator.uniform(40, 85))
        along = np.pi * generator.integers(2)
        aside = generator.normal(0, 0.35) if generator.random() < 0.8 else generator.normal(0, 1.0)
        pitch, roll = np.radians(generator.normal([-1, 0], [4, 1]))
        across = generator.uniform(-street.front + 0.5, street.front - 0.5)
        eye = np.array([generator.uniform(-25, 25), across, generator.uniform(1.2, 2.2)])
        rotation = look(along + aside, pitch, roll)
        camera = Camera(intrinsics(width, height, view_angle), rotation, eye)
        distance = world.cast(*camera.rays(width, height)).distance
        if np.mean(distance < 1.5) < 0.02 and np.median(distance) > 4:
            return camera
    return None


def _trace(
    room: Room | Street,
    world: World,
    camera: Camera,
    height: int,
    *,
    generator: np.random.Generator,
) -> _Trace:
    width = round(2 * camera.K[0, 2] + 1)
    shape = (height, width)
    origins, rays = camera.rays(width, height)
    hits = world.cast(origins, rays)
    surface = world.surface(hits, origins, rays, spread=1 / camera.K[0, 0])
    lighting = lighting_of(room.lights, room.sun, room.ambient)
    radiance = shade(world, lighting, surface, rays, shape=shape, generator=generator)
    outdoors = isinstance(room, Street)
    depth = np.minimum(hits.distance, np.float32(MAX_STREET_DEPTH_M if outdoors else MAX_DEPTH_M))
    if outdoors:
        depth[world.backdrop[surface.material]] = np.inf
    depth = depth.reshape(shape)
    return _Trace(camera, surface, depth, radiance.reshape(*shape, 3))


def _frame(world: World, trace: _Trace, image: Picture) -> RoomFrame:
    surface, shape = trace.surface, trace.depth.shape
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = trace.camera.rotation, trace.camera.position
    normals = surface.normal @ trace.camera.rotation.astype(np.float32)
    return RoomFrame(
        image=image,
        depth=trace.depth,
        K=trace.camera.K,
        camera_to_world=pose,
        normals=normals.reshape(*shape, 3),
        albedo=surface.albedo.reshape(*shape, 3),
        shininess=world.shininess[surface.material].reshape(shape),
        glass=world.glass[surface.material].reshape(shape),
    )
