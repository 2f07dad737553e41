"""Rendered frames, camera paths, sensor holes, shards and the sample frame."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import typer

from rooms.__main__ import main
from rooms.render import RoomFrame, camera_path, render_room
from rooms.sensor import BASELINE_M, projector_shadow, returned_light, sensor_holes
from rooms.shards import first_seed, shard_path, write_shards

SAMPLE = Path(__file__).resolve().parents[2] / "src" / "steered_marigold" / "assets" / "sample"


@pytest.fixture(scope="module")
def frames() -> list[RoomFrame]:
    return [render_room(seed, width=80, height=60) for seed in range(8)]


def test_a_seed_stands_for_one_frame(frames: list[RoomFrame]) -> None:
    again = render_room(0, width=80, height=60)
    np.testing.assert_array_equal(again.image, frames[0].image)
    np.testing.assert_array_equal(again.depth, frames[0].depth)
    np.testing.assert_array_equal(again.camera_to_world, frames[0].camera_to_world)
    assert not np.array_equal(frames[1].depth, frames[0].depth)


def test_depth_is_finite_everywhere_and_of_indoor_range(frames: list[RoomFrame]) -> None:
    depth = np.stack([frame.depth for frame in frames])
    assert depth.dtype == np.float32
    assert np.isfinite(depth).all()
    assert depth.min() > 0
    assert depth.max() <= 10
    assert 1.5 < np.median(depth) < 4
    assert np.mean(depth < 0.7) < 0.05


def test_normals_are_unit_and_face_the_camera(frames: list[RoomFrame]) -> None:
    for frame in frames:
        np.testing.assert_allclose(np.linalg.norm(frame.normals, axis=-1), 1, atol=1e-3)
        rays = np.stack(np.meshgrid(np.arange(80), np.arange(60)), axis=-1)
        rays = np.concatenate([rays, np.ones((60, 80, 1))], axis=-1) @ np.linalg.inv(frame.K).T
        assert np.mean((rays * frame.normals).sum(axis=-1) < 1e-6) > 0.999


def test_another_size_shows_the_same_view() -> None:
    small, large = render_room(3, width=40, height=30), render_room(3, width=120, height=90)
    np.testing.assert_allclose(large.K[0, 0], 3 * small.K[0, 0])
    # every third pixel of the large frame has the centre of a small one
    np.testing.assert_allclose(large.depth[1::3, 1::3], small.depth, rtol=1e-3)


def reproject(source: RoomFrame, target: RoomFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths of the source's points in the target, the target's depths there, which are in view."""
    height, width = source.depth.shape
    v, u = np.mgrid[0:height, 0:width]
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    points = pixels @ np.linalg.inv(source.K).T * source.depth.reshape(-1, 1)
    moved = np.linalg.inv(target.camera_to_world) @ source.camera_to_world
    points = points @ moved[:3, :3].T + moved[:3, 3]
    x, y = (points @ target.K.T)[:, :2].T / points[:, 2]
    x, y = np.round(x).astype(int), np.round(y).astype(int)
    inside = (points[:, 2] > 0.1) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    seen = target.depth[y.clip(0, height - 1), x.clip(0, width - 1)]
    return points[:, 2], seen, inside


def test_frames_of_a_path_agree_about_the_room() -> None:
    path = list(camera_path(5, 13, width=96, height=72))
    assert len(path) == 13
    first, last = path[0], path[-1]
    assert not np.allclose(first.camera_to_world, last.camera_to_world)
    expected, seen, inside = reproject(first, last)
    assert inside.mean() > 0.5
    error = (seen - expected)[inside] / expected[inside]
    assert np.mean(np.abs(error) < 0.03) > 0.9
    # a point may be hidden by something nearer, but nothing lies behind what was seen
    assert np.mean(error > 0.1) < 0.03


def wall(distance: float, *, width: int = 64, height: int = 48) -> dict[str, np.ndarray]:
    """A bright matt wall that faces the camera."""
    shape = (height, width)
    return {
        "image": np.full((*shape, 3), 128, dtype=np.uint8),
        "depth": np.full(shape, distance, dtype=np.float32),
        "K": np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]]),
        "camera_to_world": np.eye(4),
        "normals": np.broadcast_to(np.array([0, 0, -1], dtype=np.float32), (*shape, 3)).copy(),
        "albedo": np.full((*shape, 3), 0.6, dtype=np.float32),
        "shininess": np.zeros(shape, dtype=np.float32),
        "glass": np.zeros(shape, dtype=bool),
    }


@pytest.mark.parametrize(
    ("name", "value"),
    [("albedo", 0.005), ("shininess", 1.0), ("glass", True), ("depth", 7.0), ("depth", 0.2)],
)
def test_holes_are_where_a_sensor_fails(name: str, value: float) -> None:
    buffers = wall(2.0)
    if name == "shininess":
        buffers["albedo"][:] = 0.1
    buffers[name][10:40, 40:60] = value
    valid = sensor_holes(RoomFrame(**buffers), np.random.default_rng(0))
    assert valid[12:38, 42:58].mean() < 0.15
    assert valid[10:40, :16].mean() > 0.9


def test_grazing_surfaces_return_less_light() -> None:
    buffers = wall(2.0)
    facing = returned_light(RoomFrame(**buffers))
    buffers["normals"][:] = [0.995, 0.0, -0.1]
    grazing = returned_light(RoomFrame(**buffers))
    assert facing[24, 32] == pytest.approx(0.6 / 4, rel=1e-3)
    assert grazing[24, 32] < 0.2 * facing[24, 32]


def test_the_projector_shadow_is_on_the_left_and_as_wide_as_the_disparity() -> None:
    buffers = wall(4.0, width=256)
    buffers["K"] = np.array([[400.0, 0, 127.5], [0, 400.0, 23.5], [0, 0, 1]])
    buffers["depth"][:, 150:200] = 1.0
    shadow = projector_shadow(RoomFrame(**buffers))
    expected = 400.0 * BASELINE_M * (1 / 1.0 - 1 / 4.0)
    assert shadow[:, 150:].sum() == 0
    assert shadow[24].sum() == pytest.approx(expected, abs=1)
    assert shadow[24, 149]


def test_rooms_have_a_plausible_share_of_holes(frames: list[RoomFrame]) -> None:
    generator = np.random.default_rng(0)
    missing = [1 - sensor_holes(frame, generator).mean() for frame in frames]
    assert 0.05 < np.mean(missing) < 0.6
    first, again = (sensor_holes(frames[0], np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_shards_hold_the_frames_and_resume(tmp_path: Path) -> None:
    def run(frames: int) -> list[Path]:
        return list(write_shards(tmp_path, frames=frames, size=(32, 24), workers=1, seed=7))

    path = shard_path(tmp_path, 0)
    assert run(2) == [path]
    with np.load(path) as shard:
        image, depth, K = shard["image"], shard["depth"], shard["K"]
    assert (image.dtype, image.shape) == (np.uint8, (2, 24, 32, 3))
    assert (depth.dtype, depth.shape) == (np.uint16, (2, 24, 32))
    second = render_room(first_seed(7) + 1, width=32, height=24)
    np.testing.assert_array_equal(image[1], second.image)
    np.testing.assert_allclose(depth[1] / 1000, second.depth, atol=0.00051)
    np.testing.assert_allclose(K[1], second.K, rtol=1e-6)

    written = path.stat().st_mtime_ns
    assert run(2) == []
    assert path.stat().st_mtime_ns == written
    assert run(3) == [path]  # a shard that is too short is written again
    with np.load(path) as shard:
        np.testing.assert_array_equal(shard["image"][:2], image)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_bad_arguments_are_named(tmp_path: Path) -> None:
    with pytest.raises(typer.BadParameter, match="--size"):
        main(output=tmp_path, size="320,240")
    with pytest.raises(typer.BadParameter, match="--output"):
        main()


def test_the_sample_frame_is_what_a_sensor_would_give() -> None:
    image = cv2.imread(str(SAMPLE / "image.jpg"))
    depth = cv2.imread(str(SAMPLE / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert depth is not None
    assert image.shape == (480, 640, 3)
    assert depth.shape == (480, 640)
    assert depth.dtype == np.uint16
    missing = depth == 0
    assert 0.25 < missing.mean() < 0.45
    areas = cv2.connectedComponentsWithStats(missing.astype(np.uint8))[2][1:, cv2.CC_STAT_AREA]
    assert areas.max() > 0.05 * missing.size
    K = np.loadtxt(SAMPLE / "intrinsics.txt")
    assert K.shape == (3, 3)
    assert 45 <= np.degrees(2 * np.arctan(320 / K[0, 0])) <= 90
    assert sum(file.stat().st_size for file in SAMPLE.iterdir()) < 700_000
