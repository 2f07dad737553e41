import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.core.geometry import (
    center_crop,
    crop_intrinsics,
    project,
    resize_intrinsics,
    unproject,
)
from steered_marigold.errors import SizeMismatchError

K = torch.tensor([[520.0, 1.5, 31.0], [0.0, 515.0, 24.5], [0.0, 0.0, 1.0]], dtype=torch.float64)


def pixel_grid(height: int, width: int) -> torch.Tensor:
    v, u = torch.meshgrid(
        torch.arange(height, dtype=torch.float64),
        torch.arange(width, dtype=torch.float64),
        indexing="ij",
    )
    return torch.stack((u, v), dim=-1)


@given(
    fx=st.floats(50, 2000),
    fy=st.floats(50, 2000),
    cx=st.floats(-50, 50),
    cy=st.floats(-50, 50),
    seed=st.integers(0, 2**31),
)
def test_project_after_unproject_is_identity(
    fx: float, fy: float, cx: float, cy: float, seed: int
) -> None:
    intrinsics = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=torch.float64)
    generator = torch.Generator().manual_seed(seed)
    depth = 0.1 + 20 * torch.rand(2, 5, 7, generator=generator, dtype=torch.float64)
    pixels = project(unproject(depth, intrinsics), intrinsics)
    torch.testing.assert_close(pixels, pixel_grid(5, 7).expand(2, 5, 7, 2), rtol=0, atol=1e-8)


def test_unproject_inverts_the_matrix() -> None:
    depth = torch.full((4, 6), 2.0, dtype=torch.float64)
    homogeneous = torch.cat((pixel_grid(4, 6), torch.ones(4, 6, 1, dtype=torch.float64)), dim=-1)
    torch.testing.assert_close(unproject(depth, K), 2 * homogeneous @ torch.linalg.inv(K).T)


def test_axes_point_right_down_forward() -> None:
    points = unproject(torch.ones(49, 63, dtype=torch.float64), K)
    assert points[0, 62, 0] > points[0, 0, 0]
    assert points[48, 0, 1] > points[0, 0, 1]
    assert bool((points[..., 2] == 1).all())


def test_crop_moves_pixels_by_the_offset() -> None:
    points = unproject(torch.full((10, 12), 3.0, dtype=torch.float64), K)
    pixels = project(points, crop_intrinsics(K, top=4, left=5))
    expected = pixel_grid(10, 12) - torch.tensor([5.0, 4.0], dtype=torch.float64)
    torch.testing.assert_close(pixels, expected)


def test_resize_agrees_with_torch_interpolation() -> None:
    # A smooth image of x coordinates, halved: each new pixel holds the x it covered.
    columns = torch.arange(12, dtype=torch.float64).expand(8, 12)
    halved = torch.nn.functional.interpolate(columns[None, None], size=(4, 6), mode="area")[0, 0]
    new_K = resize_intrinsics(K, size=(8, 12), new_size=(4, 6))
    points = unproject(torch.ones(4, 6, dtype=torch.float64), new_K)
    torch.testing.assert_close(project(points, K)[..., 0], halved)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 40), st.integers(1, 40))
def test_resize_and_back_is_identity(height: int, width: int, rows: int, columns: int) -> None:
    there = resize_intrinsics(K, size=(height, width), new_size=(rows, columns))
    back = resize_intrinsics(there, size=(rows, columns), new_size=(height, width))
    torch.testing.assert_close(back, K)


@given(st.integers(1, 30), st.integers(1, 30), st.data())
def test_center_crop_is_centred(height: int, width: int, data: st.DataObject) -> None:
    crop = data.draw(st.integers(1, height)), data.draw(st.integers(1, width))
    rows, columns = center_crop((height, width), crop)
    assert (rows.stop - rows.start, columns.stop - columns.start) == crop
    assert 0 <= (height - rows.stop) - rows.start <= 1
    assert 0 <= (width - columns.stop) - columns.start <= 1


def test_paper_crop_leaves_16_pixels_on_each_side() -> None:
    assert center_crop((480, 640), (448, 608)) == (slice(16, 464), slice(16, 624))


def test_too_small_an_image_names_both_sizes() -> None:
    with pytest.raises(SizeMismatchError, match=r"608x448 px .* 320x240 px"):
        center_crop((240, 320), (448, 608))
