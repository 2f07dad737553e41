"""One rendered RGB-D frame of a random room."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from training.rooms.camera import Camera, intrinsics, look
from training.rooms.layout import Room, build_room
from training.rooms.photo import photograph
from training.rooms.raycast import World
from training.rooms.shading import lighting_of, shade

MAX_DEPTH_M = 10.0


@dataclass(frozen=True, kw_only=True)
class RoomFrame:
    """A rendered frame; everything per pixel, aligned.

    image: RGB in 0..255. depth: metric, along the optical axis, [m], finite, at most 10; mirrors
    and panes have the depth of their surface. K: intrinsics [px]. camera_to_world: rigid motion
    [m]. normals: unit, camera frame, towards the camera. albedo: linear RGB. shininess: 0..1.
    glass: True on panes and mirrors.
    """

    image: UInt8[np.ndarray, "height width 3"]
    depth: Float32[np.ndarray, "height width"]
    K: Float[np.ndarray, "3 3"]
    camera_to_world: Float[np.ndarray, "4 4"]
    normals: Float32[np.ndarray, "height width 3"]
    albedo: Float32[np.ndarray, "height width 3"]
    shininess: Float32[np.ndarray, "height width"]
    glass: Bool[np.ndarray, "height width"]


def render_room(seed: int, *, width: int = 320, height: int = 240) -> RoomFrame:
    """A frame of the room, camera and photograph that `seed` (>= 0) stands for."""
    generator = np.random.default_rng(seed)
    room, world, camera = _room_with_view(generator, width / height)
    return render(room, world, camera, width=width, height=height, generator=generator)


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
    width, height = 32, max(8, round(32 / aspect))
    best, best_score = None, 0.0
    for _ in range(int(generator.integers(5, 16))):
        view_angle = np.radians(generator.triangular(45, 58, 90))
        pitch = np.radians(np.clip(generator.normal(-10, 9), -40, 15))
        roll = np.radians(generator.normal(0, 2.5))
        rotation = look(generator.uniform(0, 2 * np.pi), pitch, roll)
        eye = np.array([*room.eye, min(generator.uniform(0.7, 1.75), room.height - 0.3)])
        camera = Camera(intrinsics(width, height, view_angle), rotation, eye)
        rays = camera.rays(width, height).reshape(-1, 3)
        hits = world.cast(np.tile(eye.astype(np.float32), (len(rays), 1)), rays)
        depth = np.minimum(hits.distance, MAX_DEPTH_M)
        near = float(np.mean(depth < 0.7)) + float(np.median(depth) < 1.3)
        variety = len(np.unique(world.material_of(hits)))
        score = np.log(variety) + float(np.std(np.log(depth))) - 20 * near
        if score > best_score:
            best, best_score = camera, score
    return best


def render(
    room: Room,
    world: World,
    camera: Camera,
    *,
    width: int,
    height: int,
    generator: np.random.Generator,
) -> RoomFrame:
    """A frame of the given room from the given camera, whose K may be for another width."""
    camera = camera.resized(width / (2 * camera.K[0, 2] + 1))
    rays = camera.rays(width, height).reshape(-1, 3)
    origins = np.tile(camera.position.astype(np.float32), (len(rays), 1))
    hits = world.cast(origins, rays)
    surface = world.surface(hits, origins, rays, spread=1 / camera.K[0, 0])
    lighting = lighting_of(room.lights, room.sun, room.ambient)
    shape = (height, width)
    radiance = shade(world, lighting, surface, rays, shape=shape, generator=generator)
    depth = np.minimum(hits.distance, np.float32(MAX_DEPTH_M))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation, camera.position
    return RoomFrame(
        image=photograph(radiance.reshape(*shape, 3), generator),
        depth=depth.reshape(shape),
        K=camera.K,
        camera_to_world=pose,
        normals=(surface.normal @ camera.rotation.astype(np.float32)).reshape(*shape, 3),
        albedo=surface.albedo.reshape(*shape, 3),
        shininess=world.shininess[surface.material].reshape(shape),
        glass=world.glass[surface.material].reshape(shape),
    )
