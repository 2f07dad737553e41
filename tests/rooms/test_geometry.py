"""Meshes, textures, cameras and rays of the room generator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rooms import materials as made_of
from rooms.bank import layers, lookup, mean_albedo
from rooms.camera import Camera, hand_held, intrinsics, look
from rooms.clutter import floor_thing, small_thing
from rooms.mesh import box, boxes, can, join, lathe, pillow, rods, sheet
from rooms.raycast import FAR_M, World
from rooms.themes import THEMES, Make

ANGLES = st.floats(-3.1, 3.1)


def material(seed: int = 0) -> made_of.Material:
    return made_of.plastic(np.random.default_rng(seed))


def test_a_box_has_the_area_of_its_faces() -> None:
    a, b, c = 0.5, 1.0, 2.0
    corners = box([1, 2, 3], [1 + a, 2 + b, 3 + c]).corners
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    assert area == pytest.approx(2 * (a * b + b * c + c * a))


def test_normals_of_round_shapes_are_unit_and_perpendicular() -> None:
    ball = pillow([2.0, 2.0, 2.0], square=1.0, resolution=24)
    np.testing.assert_allclose(np.linalg.norm(ball.normals, axis=-1), 1, atol=1e-4)
    # on a sphere the normal is the position, up to sign
    alignment = np.abs((ball.normals * ball.corners).sum(axis=-1))
    assert alignment.min() > 0.98
    tube = rods(np.array([[0.0, 0, 0]]), np.array([[1.0, 2, 3]]), 0.1)
    along = tube.normals @ np.array([1.0, 2, 3]) / np.sqrt(14)
    np.testing.assert_allclose(along, 0, atol=1e-5)


@given(yaw=ANGLES)
def test_moving_a_mesh_keeps_lengths_and_normals(yaw: float) -> None:
    mesh = lathe([(0.1, 0.0), (0.3, 1.0)])
    moved = mesh.moved([1.0, -2.0, 0.5], yaw)
    before, after = (np.diff(m.corners, axis=1) for m in (mesh, moved))
    lengths = np.linalg.norm(before, axis=-1)
    np.testing.assert_allclose(np.linalg.norm(after, axis=-1), lengths, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(moved.normals, axis=-1), 1, atol=1e-4)
    np.testing.assert_allclose(moved.corners[..., 2], mesh.corners[..., 2] + 0.5, atol=1e-5)


def test_facets_of_joined_meshes_stay_apart() -> None:
    parts = [can(0.2, 0, 1), boxes(np.zeros((2, 3)), np.ones((2, 3))), pillow([1, 1, 1])]
    whole = join(parts)
    assert len(np.unique(whole.facet)) == 3 + 12 + 1
    assert len(whole.corners) == sum(len(part.corners) for part in parts)


def test_a_sheet_keeps_its_points() -> None:
    x, y = np.meshgrid(np.arange(3.0), np.arange(4.0))
    flat = sheet(np.stack([x, y, 0 * x], axis=-1))
    assert len(flat.corners) == 2 * 2 * 3
    np.testing.assert_allclose(np.abs(flat.normals[..., 2]), 1, atol=1e-6)
    np.testing.assert_allclose(flat.uv, flat.corners[..., :2], atol=1e-6)


MAKERS = {make.__name__: make for theme in THEMES for _, make in theme.at_walls}


@pytest.mark.parametrize("make", [*MAKERS.values(), small_thing, floor_thing])
def test_models_stand_on_the_floor_within_their_size(make: Make) -> None:
    for seed in range(6):
        model = make(np.random.default_rng(seed))
        whole = join([mesh for mesh, _ in model.parts])
        points = whole.corners.reshape(-1, 3)
        assert np.isfinite(points).all()
        np.testing.assert_allclose(np.linalg.norm(whole.normals, axis=-1), 1, atol=1e-3)
        width, depth, height = model.size
        slack = 0.3  # leaves, cushions and blankets reach a little further
        low, high = points.min(axis=0), points.max(axis=0)
        assert -0.03 < low[2] < 0.15
        assert high[2] < height + slack
        assert (low[:2] > [-width / 2 - slack, -slack]).all()
        assert (high[:2] < [width / 2 + slack, depth + slack]).all()


def test_textures_repeat_and_blur_to_their_mean() -> None:
    generator = np.random.default_rng(0)
    layer = np.repeat(list(layers("art")), 50)
    uv = generator.uniform(-3, 3, (len(layer), 2)).astype(np.float32)
    sharp = np.full(len(layer), 1e-3, dtype=np.float32)
    first, shifted = lookup(layer, uv, sharp), lookup(layer, uv + np.float32(2), sharp)
    np.testing.assert_allclose(first, shifted, atol=0.02)
    assert first.min() >= 0
    assert first.max() <= 1
    coarse = lookup(layer, uv, np.full(len(layer), 9.0, dtype=np.float32))
    per_layer = coarse.reshape(-1, 50, 3)
    assert per_layer.std(axis=1).mean() < first.reshape(-1, 50, 3).std(axis=1).mean()
    means = mean_albedo(np.array(layers("art")))
    assert np.abs(per_layer.mean(axis=1) - means).max() < 0.1


def depth_in_a_box(camera: Camera, size: np.ndarray, width: int, height: int) -> np.ndarray:
    """z-depth of the walls of the box 0..size seen from inside, from the plane equations."""
    depth = np.empty((height, width))
    for v in range(height):
        for u in range(width):
            ray = camera.rotation @ np.linalg.inv(camera.K) @ np.array([u, v, 1.0])
            planes = [
                (wall - camera.position[axis]) / ray[axis]
                for axis in range(3)
                for wall in (0.0, size[axis])
                if abs(ray[axis]) > 1e-12
            ]
            depth[v, u] = min(t for t in planes if t > 0)
    return depth


@settings(max_examples=15)
@given(yaw=ANGLES, pitch=st.floats(-0.7, 0.7), roll=st.floats(-0.5, 0.5), angle=st.floats(0.8, 1.6))
def test_distances_along_camera_rays_are_z_depth(
    yaw: float, pitch: float, roll: float, angle: float
) -> None:
    size, position = np.array([4.0, 5.0, 2.5]), np.array([1.0, 3.0, 1.4])
    camera = Camera(intrinsics(16, 12, angle), look(yaw, pitch, roll), position)
    world = World([(box([0, 0, 0], size), material())])
    hits = world.cast(*camera.rays(16, 12))
    expected = depth_in_a_box(camera, size, 16, 12)
    np.testing.assert_allclose(hits.distance.reshape(12, 16), expected, rtol=1e-4)


def test_what_rays_miss_is_far_and_nothing_is_blocked() -> None:
    world = World([(box([0, 0, 0], [1, 1, 1]), material())])
    origin = np.array([[0.5, 0.5, 3.0], [0.5, 0.5, 3.0]], dtype=np.float32)
    direction = np.array([[0.0, 0, 1], [0, 0, -1]], dtype=np.float32)
    hits = world.cast(origin, direction)
    assert hits.triangle[0] == -1
    assert hits.distance.tolist() == [FAR_M, 2.0]
    for reach, expected in ((1.9, [False, False]), (2.1, [False, True])):
        blocked = world.blocked(origin, direction, np.full(2, reach, dtype=np.float32))
        assert blocked.tolist() == expected


@given(yaw=ANGLES, pitch=st.floats(-1.2, 1.2), roll=ANGLES)
def test_camera_axes_are_a_right_handed_frame(yaw: float, pitch: float, roll: float) -> None:
    rotation = look(yaw, pitch, roll)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert look(yaw, pitch, 0.0)[2, 1] < 0  # the camera's y axis points down


@given(factor=st.integers(1, 5))
def test_a_resized_camera_sees_the_same_view(factor: int) -> None:
    camera = Camera(intrinsics(32, 24, 1.0), np.eye(3), np.zeros(3))
    resized = camera.resized(32 * factor)
    # the left border of the image, half a pixel outside the first pixel's centre
    for view, width in ((camera, 32), (resized, 32 * factor)):
        left = (-0.5 - view.K[0, 2]) / view.K[0, 0]
        right = (width - 0.5 - view.K[0, 2]) / view.K[0, 0]
        assert -left == pytest.approx(right)
        assert right == pytest.approx(np.tan(0.5))


def test_a_hand_held_camera_starts_where_it_is_and_moves_smoothly() -> None:
    camera = Camera(intrinsics(32, 24, 1.0), look(0.3, -0.2, 0.0), np.array([1.0, 2.0, 1.5]))
    views = list(hand_held(camera, 60, np.random.default_rng(1)))
    np.testing.assert_allclose(views[0].position, camera.position)
    np.testing.assert_allclose(views[0].rotation, camera.rotation, atol=1e-12)
    steps = np.diff([view.position for view in views], axis=0)
    assert 0 < np.abs(steps).max() < 0.02
    for view in views:
        np.testing.assert_allclose(view.rotation.T @ view.rotation, np.eye(3), atol=1e-9)
        assert np.abs(view.position - camera.position).max() <= 0.31
