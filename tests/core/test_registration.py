"""Measurements move to the image's grid as points."""

import math
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.core.edge_agreement import edge_agreement, misalignment_doubts
from steered_marigold.core.registration import register_depth, register_depth_camera
from steered_marigold.errors import InputError, SizeMismatchError
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.images import read_image


def _sensor(rows: int, columns: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    depth = 1 + torch.rand(rows, columns, generator=generator)
    return depth, torch.rand(rows, columns, generator=generator) < 0.7


@given(
    rows=st.integers(1, 12),
    columns=st.integers(1, 12),
    up=st.integers(1, 5),
    seed=st.integers(0, 9),
)
def test_no_measurement_is_lost_changed_or_invented_on_a_finer_grid(
    rows: int, columns: int, up: int, seed: int
) -> None:
    depth, mask = _sensor(rows, columns, seed)
    moved = register_depth(depth, mask, (rows * up, columns * up))
    assert torch.equal(moved.depth[moved.valid_mask].sort()[0], depth[mask].sort()[0])
    assert torch.equal(moved.depth > 0, moved.valid_mask)
    if up % 2:  # the middle of an odd block
        centre = slice(up // 2, None, up)
        assert torch.equal(moved.valid_mask[centre, centre], mask)


@given(
    rows=st.integers(4, 20),
    columns=st.integers(4, 20),
    down=st.sampled_from([2, 3, 4]),
    seed=st.integers(0, 9),
)
def test_each_pixel_holds_the_nearest_of_its_measurements(
    rows: int, columns: int, down: int, seed: int
) -> None:
    """Plain loops, from the definition, on a coarser image."""
    depth, mask = _sensor(rows * down, columns * down, seed)
    moved = register_depth(depth, mask, (rows, columns))
    for y in range(rows):
        for x in range(columns):
            block = (slice(y * down, (y + 1) * down), slice(x * down, (x + 1) * down))
            values = depth[block][mask[block]]
            assert bool(moved.valid_mask[y, x]) == (len(values) > 0)
            if len(values):
                assert moved.depth[y, x] == values.min()


def test_an_equal_grid_changes_nothing() -> None:
    depth, mask = _sensor(7, 9, 0)
    moved = register_depth(depth, mask, (7, 9))
    assert torch.equal(moved.valid_mask, mask)
    assert torch.equal(moved.depth, torch.where(mask, depth, 0.0))


def test_other_maps_move_with_the_measurement_that_won() -> None:
    depth = torch.tensor([[3.0, 1.0], [2.0, 5.0]])
    mask = torch.tensor([[True, True], [True, False]])
    confidence = torch.tensor([[0.1, 0.2], [0.3, 0.4]])
    moved = register_depth(depth, mask, (1, 1))
    assert moved.depth.item() == 1
    assert moved.carry(confidence).item() == pytest.approx(0.2)
    empty = register_depth(depth, torch.zeros_like(mask), (4, 4))
    assert not empty.valid_mask.any()
    assert not empty.carry(confidence).any()


def test_sizes_that_only_rounding_separates_agree() -> None:
    for sensor, image in (((192, 256), (1440, 1920)), ((187, 620), (375, 1241))):
        depth, mask = _sensor(*sensor, 0)
        assert register_depth(depth, mask, image).depth.shape == image


@pytest.mark.parametrize("size", [(480, 640), (192, 192), (1920, 1440)])
def test_another_aspect_ratio_is_refused(size: tuple[int, int]) -> None:
    depth, mask = _sensor(171, 224, 0)
    with pytest.raises(SizeMismatchError, match=r"224x171.*aspect ratio"):
        register_depth(depth, mask, size)


def test_sizes_that_nearly_fit_say_which_crop_would() -> None:
    depth, mask = _sensor(480, 640, 0)
    with pytest.raises(SizeMismatchError, match=r"crop the image to 1291x968 about its middle"):
        register_depth(depth, mask, (968, 1296))
    assert register_depth(depth, mask, (968, 1291)).depth.shape == (968, 1291)


def _camera(focal: float, size: tuple[int, int]) -> torch.Tensor:
    height, width = size
    return torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])


def _moved(x: float, y: float, z: float, turn: float = 0.0) -> torch.Tensor:
    """A turn about the vertical [rad], then a move [m]."""
    cos, sin = math.cos(turn), math.sin(turn)
    return torch.tensor(
        [[cos, 0, sin, x], [0, 1, 0, y], [-sin, 0, cos, z], [0, 0, 0, 1]], dtype=torch.float64
    )


def _brute_force(
    depth: torch.Tensor,
    mask: torch.Tensor,
    depth_K: torch.Tensor,
    image_K: torch.Tensor,
    extrinsics: torch.Tensor,
    size: tuple[int, int],
) -> dict[tuple[int, int], tuple[float, tuple[int, int]]]:
    """The nearest measurement whose rectangle holds a pixel's centre, for each; plain loops."""
    seen: dict[tuple[int, int], tuple[float, tuple[int, int]]] = {}
    E = extrinsics.tolist()
    (fx, _, cx), (_, fy, cy), _ = depth_K.double().tolist()
    (gx, _, dx), (_, gy, dy), _ = image_K.double().tolist()
    for v, u in mask.nonzero().tolist():
        z = float(depth[v, u])
        point = ((u - cx) / fx * z, (v - cy) / fy * z, z, 1.0)
        X, Y, Z = (sum(a * b for a, b in zip(row, point, strict=True)) for row in E[:3])
        if Z <= 0:
            continue
        x, y = gx * X / Z + dx, gy * Y / Z + dy
        growth = min(z / Z, 4.0)
        half_x, half_y = gx / fx * growth / 2, gy / fy * growth / 2
        columns = range(math.ceil(x - half_x - 1e-6), math.ceil(x + half_x)) or [round(x)]
        rows = range(math.ceil(y - half_y - 1e-6), math.ceil(y + half_y)) or [round(y)]
        for row in rows:
            for column in columns:
                if 0 <= row < size[0] and 0 <= column < size[1]:
                    old = seen.get((row, column))
                    if old is None or old[0] > Z:
                        seen[row, column] = (Z, (v, u))
    return seen


@settings(max_examples=25)
@given(
    seed=st.integers(0, 99),
    focal=st.floats(6, 40),
    x=st.floats(-0.2, 0.2),
    z=st.floats(-0.5, 0.3),
    turn=st.floats(-0.2, 0.2),
)
def test_another_camera_sees_the_nearest_of_what_covers_each_pixel(
    seed: int, focal: float, x: float, z: float, turn: float
) -> None:
    depth, mask = _sensor(9, 12, seed)
    size = (14, 18)
    cameras = _camera(14.0, (9, 12)), _camera(focal, size)
    motion = _moved(x, 0.05, z, turn)
    moved = register_depth_camera(
        depth, mask, depth_K=cameras[0], image_K=cameras[1], extrinsics=motion, size=size
    )
    expected = _brute_force(depth, mask, *cameras, motion, size)
    for v, u in moved.valid_mask.nonzero().tolist():
        nearest, (row, column) = expected[v, u]
        assert float(moved.depth[v, u]) == pytest.approx(nearest, rel=1e-6)
        assert int(moved.source[v, u]) == row * 12 + column
    for (v, u), (nearest, _) in expected.items():
        if not moved.valid_mask[v, u]:  # hidden: most of its neighbours are nearer
            around = [expected.get((v + i, u + j)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
            assert sum(one is not None and one[0] < nearest * 0.9501 for one in around) >= 5


def test_a_finer_image_gets_no_holes_and_the_same_camera_changes_nothing() -> None:
    depth = torch.full((24, 32), 2.0)
    mask = torch.ones(24, 32, dtype=torch.bool)
    K = torch.tensor([[30.0, 0, 15.5], [0, 30, 11.5], [0, 0, 1]])
    identity = torch.eye(4)
    same = register_depth_camera(
        depth, mask, depth_K=K, image_K=K, extrinsics=identity, size=(24, 32)
    )
    assert torch.equal(same.depth, depth)
    assert torch.equal(same.source.flatten(), torch.arange(24 * 32))
    fine = torch.tensor([[129.0, 0, 66.5], [0, 129, 49.5], [0, 0, 1]])
    finer = register_depth_camera(
        depth, mask, depth_K=K, image_K=fine, extrinsics=identity, size=(100, 134)
    )
    assert bool(finer.valid_mask[1:-1, 1:-1].all())
    assert set(finer.depth[finer.valid_mask].tolist()) == {2.0}


def test_a_near_box_hides_the_wall_behind_it() -> None:
    """The image's camera is finer and to the side: no wall shows through the box's pixels."""
    depth = torch.full((60, 80), 4.0)
    depth[20:40, 30:50] = 1.0
    K = torch.tensor([[70.0, 0, 39.5], [0, 70, 29.5], [0, 0, 1]])
    fine = torch.tensor([[140.0, 0, 79.5], [0, 140, 59.5], [0, 0, 1]])
    seen = register_depth_camera(
        depth, depth > 0, depth_K=K, image_K=fine, extrinsics=_moved(-0.2, 0, 0), size=(120, 160)
    )
    left = round(140 * ((30 - 39.5) / 70 - 0.2) + 79.5)
    box = seen.depth[42:78, left + 2 : left + 38]
    assert bool((box == 1).all())
    assert bool((seen.depth[42:78, left + 50 : left + 56] == 0).all()), "no camera saw behind it"
    confidence = torch.where(depth == 1, 0.25, 1.0)
    carried = seen.carry(confidence)
    assert bool((carried[seen.depth == 1] == 0.25).all())


def test_points_behind_the_camera_and_outside_its_view_are_left_out() -> None:
    depth, mask = torch.ones(4, 5), torch.ones(4, 5, dtype=torch.bool)
    K = _camera(5.0, (4, 5))
    for motion in (_moved(0, 0, -2.0), _moved(50, 0, 0)):
        moved = register_depth_camera(
            depth, mask, depth_K=K, image_K=K, extrinsics=motion, size=(4, 5)
        )
        assert not moved.valid_mask.any()
    close = register_depth_camera(
        depth, mask, depth_K=K, image_K=K, extrinsics=_moved(0, 0, -0.9999), size=(4, 5)
    )
    assert float(close.depth.max()) < 0.001


def test_extrinsics_are_a_rigid_motion() -> None:
    depth, mask = _sensor(4, 5, 0)
    K = _camera(5.0, (4, 5))
    mirrored = torch.diag(torch.tensor([-1.0, 1, 1, 1]))
    for bad in (torch.eye(4) * 2, mirrored, torch.zeros(4, 4)):
        with pytest.raises(InputError, match="`extrinsics` must be"):
            register_depth_camera(depth, mask, depth_K=K, image_K=K, extrinsics=bad, size=(4, 5))


@pytest.mark.parametrize("frame", ["0000", "0060"])
def test_a_real_depth_camera_meets_the_edges_of_the_image(sequence: Path, frame: str) -> None:
    folder = sequence / "unregistered"
    image = read_image(folder / f"{frame}_color.jpg").pixels
    sensor = read_depth(folder / f"{frame}_depth.png")
    motion = torch.eye(4)
    motion[0, 3] = -0.025
    cameras = (torch.tensor([[f, 0, 320.0], [0, f, 240], [0, 0, 1]]) for f in (585.0, 525.0))
    seen = register_depth_camera(
        sensor.depth,
        sensor.valid_mask,
        depth_K=next(cameras),
        image_K=next(cameras),
        extrinsics=motion,
        size=(480, 640),
    )
    before = edge_agreement(image, sensor.depth, sensor.valid_mask)
    after = edge_agreement(image, seen.depth, seen.valid_mask)
    assert before is not None
    assert after is not None
    assert after.here > after.best
    assert before.best > before.here + 2.2
    assert after.here > before.here + 3
    notices = misalignment_doubts(image, sensor.depth, sensor.valid_mask)
    assert [notice.kind for notice in notices] == ["misaligned"]
    assert misalignment_doubts(image, seen.depth, seen.valid_mask) == ()
