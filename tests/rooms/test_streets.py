"""Streets have a sky, a far end and true depth; textures may be crops of photographs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rooms.bank import use_crops
from rooms.render import MAX_STREET_DEPTH_M, RoomFrame, render_room, render_street
from rooms.shards import CROPS, DRAWN, shards_in, write_shards
from rooms.textures import SIDE


@pytest.fixture(scope="module")
def streets() -> list[RoomFrame]:
    return [render_street(seed, width=80, height=60) for seed in range(6)]


@pytest.fixture
def red() -> Iterator[dict[str, np.ndarray]]:
    """Crops that are all red; the drawn textures are back afterwards."""
    image = np.zeros((2, SIDE, SIDE, 3), np.uint8)
    image[..., 0] = 255
    yield dict.fromkeys(("plain", "pattern", "picture"), image)
    use_crops({}, 0)


def test_a_seed_stands_for_one_street(streets: list[RoomFrame]) -> None:
    again = render_street(0, width=80, height=60)
    np.testing.assert_array_equal(again.image, streets[0].image)
    np.testing.assert_array_equal(again.depth, streets[0].depth)


def test_depth_reaches_far_and_the_sky_is_above(streets: list[RoomFrame]) -> None:
    skies = []
    for frame in streets:
        sky = np.isinf(frame.depth)
        solid = frame.depth[~sky]
        assert solid.min() > 0
        assert solid.max() <= MAX_STREET_DEPTH_M
        assert sky[-1].mean() < 0.05
        assert solid.max() > 12
        skies.append(sky[0].mean())
    assert max(skies) > 0.5


def test_the_road_lies_flat_below_the_camera(streets: list[RoomFrame]) -> None:
    """Points of the lowest rows are near the ground, whatever stands on it."""
    heights = []
    for frame in streets:
        v, u = np.mgrid[50:60, :80]
        depth = frame.depth[50:60]
        near = depth < 30
        rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(frame.K).T
        points = (rays * depth[..., None])[near] @ frame.camera_to_world[:3, :3].T
        heights.append(points[:, 2] + frame.camera_to_world[2, 3])
    heights_all = np.concatenate(heights)
    assert np.median(heights_all) < 0.3
    assert heights_all.min() > -0.05


def test_crops_colour_the_surfaces_and_go_again(red: dict[str, np.ndarray]) -> None:
    drawn = render_room(3, width=40, height=30)
    use_crops(red, 1)
    reddened = render_room(3, width=40, height=30)
    np.testing.assert_array_equal(reddened.depth, drawn.depth)
    redness = [f.albedo[..., 0].mean() / f.albedo.mean() for f in (drawn, reddened)]
    assert redness[1] > redness[0] + 0.3
    use_crops({}, 0)
    np.testing.assert_array_equal(render_room(3, width=40, height=30).albedo, drawn.albedo)


def test_shards_tell_what_their_textures_are(tmp_path: Path, red: dict[str, np.ndarray]) -> None:
    path = tmp_path / "crops.npz"
    np.savez(path, allow_pickle=False, **red)
    for crops in (path, None):
        size = 32, 24
        shards = write_shards(
            tmp_path, frames=1, size=size, workers=1, seed=0, streets=True, crops=crops
        )
        list(shards)
    for name in (DRAWN, CROPS):
        (shard,) = shards_in(tmp_path, name)
        with np.load(shard) as arrays:
            assert arrays["depth"].shape == (1, 24, 32)
            assert arrays["depth"].max() == 65535
