"""What the numbers of depth files mean: coded here from each definition, then read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.geometry import unproject
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.depth_maps import read_depth

K = torch.tensor([[50.0, 0, 8.3], [0, 52.0, 5.9], [0, 0, 1]])
DEPTH = torch.from_numpy(np.random.default_rng(0).uniform(0.4, 7, (12, 17)).astype(np.float32))


def _read(path: Path, array: Any, encoding: str, **arguments: Any) -> torch.Tensor:
    if path.suffix == ".npy":
        np.save(path, array)
    else:
        Image.fromarray(array).save(path)
    return read_depth(path, depth_encoding=encoding, **arguments).depth


def test_length_along_the_ray(tmp_path: Path) -> None:
    ray = unproject(DEPTH, K).norm(dim=-1).numpy()
    torch.testing.assert_close(_read(tmp_path / "a.npy", ray, "ray", K=K), DEPTH)
    codes = np.rint(ray * 1000).astype(np.uint16)
    assert (_read(tmp_path / "a.png", codes, "ray", K=K) - DEPTH).abs().max() < 6e-4


def test_disparity_in_pixels(tmp_path: Path) -> None:
    shift = (50 * 0.12 / DEPTH).numpy()
    shift[0, :3] = 0, np.inf, np.nan
    camera = {"K": K, "baseline": 0.12}
    back = _read(tmp_path / "a.npy", shift, "disparity", **camera)
    torch.testing.assert_close(back[1:], DEPTH[1:])
    assert back[0, :3].tolist() == [0, 0, 0]
    codes = np.rint(np.nan_to_num(shift, posinf=0) * 256).astype(np.uint16)
    coded = _read(tmp_path / "a.png", codes, "disparity", depth_scale=1 / 256, **camera)
    assert ((coded - DEPTH) / DEPTH)[1:].abs().max() < 0.003
    whole = np.full((4, 5), 3, np.uint8)  # Middlebury counts whole pixels in 8 bits
    near = _read(tmp_path / "b.png", whole, "disparity", depth_scale=1.0, **camera)
    torch.testing.assert_close(near, torch.full((4, 5), 2.0))
    with pytest.raises(InputError, match=r"integers.*`depth_scale`.*pixels"):
        _read(tmp_path / "a.png", codes, "disparity", **camera)


def test_inverse_depth(tmp_path: Path) -> None:
    torch.testing.assert_close(_read(tmp_path / "a.npy", (1 / DEPTH).numpy(), "inverse"), DEPTH)
    codes = np.rint(2000 / DEPTH.numpy()).astype(np.uint16)
    back = _read(tmp_path / "a.png", codes, "inverse", depth_scale=1 / 2000)
    assert ((back - DEPTH) / DEPTH).abs().max() < 0.003


def test_sunrgbd_rotates_16_bits(tmp_path: Path) -> None:
    millimetres = np.array([[0, 1, 700, 8191, 8192, 30000]], np.uint16)
    rotated = millimetres << 3 | millimetres >> 13
    back = _read(tmp_path / "a.png", rotated, "sunrgbd")
    torch.testing.assert_close(back, torch.tensor([[0, 0.001, 0.7, 8.191, 8.192, 30.0]]))
    with pytest.raises(FileFormatError, match="16 bits"):
        _read(tmp_path / "a.npy", rotated.astype(np.int32), "sunrgbd")


@pytest.mark.parametrize(("encoding", "unit"), [("tum", 5000), ("kitti", 256)])
def test_units_of_data_sets(tmp_path: Path, encoding: str, unit: int) -> None:
    codes = np.array([[0, 100, unit, 2 * unit]], np.uint16)
    back = _read(tmp_path / "a.png", codes, encoding)
    torch.testing.assert_close(back, torch.tensor([[0, 100 / unit, 1.0, 2.0]]))
    with pytest.raises(InputError, match="its own unit"):
        _read(tmp_path / "a.png", codes, encoding, depth_scale=0.001)
    with pytest.raises(FileFormatError, match="integers"):
        _read(tmp_path / "a.npy", codes / 1.0, encoding)


def test_bytes_in_colours(tmp_path: Path) -> None:
    whole = np.rint(DEPTH.numpy().astype(np.float64) / 1000 * (2**24 - 1)).astype(np.int64)
    low, middle, high = (whole >> shift & 255 for shift in (0, 8, 16))
    carla = np.stack([low, middle, high], axis=-1).astype(np.uint8)
    assert (_read(tmp_path / "a.png", carla, "carla") - DEPTH).abs().max() < 4e-5
    tenths = np.rint(DEPTH.numpy() * 1e4).astype(np.int64)
    rgb = np.stack([tenths >> 16, tenths >> 8 & 255, tenths & 255], axis=-1).astype(np.uint8)
    back = _read(tmp_path / "a.png", rgb, "rgb24", depth_scale=1e-4)
    assert (back - DEPTH).abs().max() < 6e-5
    blue_first = DEPTH.numpy().astype("<f4").view(np.uint8).reshape(*DEPTH.shape, 4)
    tartan = np.ascontiguousarray(blue_first[..., [2, 1, 0, 3]])
    assert torch.equal(_read(tmp_path / "a.png", tartan, "tartanair"), DEPTH)
    with pytest.raises(FileFormatError, match="4 channels of 8 bits"):
        _read(tmp_path / "a.png", carla, "tartanair")
    with pytest.raises(FileFormatError, match=r"`depth_encoding` \(carla, rgb24, tartanair\)"):
        _read(tmp_path / "a.png", carla, "z")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"depth_encoding": "metres"}, "one of z, ray"),
        ({"depth_encoding": "ray"}, "`K`"),
        ({"depth_encoding": "disparity", "baseline": 0.1}, "`K`"),
        ({"depth_encoding": "disparity", "K": K}, "`baseline`"),
        ({"baseline": 0.1}, "`baseline`"),
        ({"depth_encoding": "disparity", "K": K, "baseline": -0.1}, "`baseline`"),
        ({"depth_encoding": "carla", "depth_scale": 1.0}, "its own unit"),
    ],
)
def test_arguments_that_do_not_fit(tmp_path: Path, arguments: dict[str, Any], problem: str) -> None:
    np.save(tmp_path / "a.npy", DEPTH.numpy())
    with pytest.raises(InputError, match=problem):
        read_depth(tmp_path / "a.npy", **arguments)
