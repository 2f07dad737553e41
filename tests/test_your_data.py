"""Every line of docs/your-data.md runs on files of the form that it is for, made here."""

import re
import shlex
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

from steered_marigold.cli import app
from steered_marigold.io.depth_maps import read_depth

PAGE = Path(__file__).resolve().parents[1] / "docs" / "your-data.md"
LINES = re.findall(r"^steered-marigold complete .*$", PAGE.read_text(), re.M)
HEIGHT, WIDTH = 96, 128


def _metres(height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float64]:
    """A floor and a box before a wall, with a hole."""
    rows = np.linspace(-1, 1, height)[:, None]
    depth = np.broadcast_to(np.minimum(3.0, 1.6 / np.maximum(rows, 0.01)), (height, width)).copy()
    depth[height // 3 : 2 * height // 5, width // 4 : 2 * width // 5] = 1.2
    depth[: height // 6, : width // 5] = 0
    return depth


def _image(path: Path, height: int = HEIGHT, width: int = WIDTH) -> None:
    path.parent.mkdir(exist_ok=True)
    near = (200 / np.maximum(_metres(height, width), 1)).astype(np.uint8)
    Image.fromarray(np.stack([near, near // 2, 255 - near], axis=-1)).save(path)


def _codes(path: Path, unit: float, depth: NDArray[np.float64] | None = None) -> None:
    path.parent.mkdir(exist_ok=True)
    depth = _metres() if depth is None else depth
    Image.fromarray(np.rint(depth / unit).astype(np.uint16)).save(path)


def _inverse() -> NDArray[np.float64]:
    depth = _metres()
    return np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)


def _pfm(path: Path, values: NDArray[np.float64]) -> None:
    header = f"Pf\n{values.shape[1]} {values.shape[0]}\n-1.0\n".encode()
    path.write_bytes(header + values[::-1].astype("<f4").tobytes())


def _realsense() -> None:
    _image(Path("color.png"))
    _codes(Path("aligned_depth.png"), 0.001)


def _realsense_viewer() -> None:
    _image(Path("shot_Color.png"), 480, 640)
    codes = np.rint(_metres(240, 320) * 1000).astype("<u2")
    Path("shot_Depth.raw").write_bytes(codes.tobytes())
    Path("shot_Depth_metadata.csv").write_text(
        "Frame Info: \nType,Depth\nFormat,Z16\nResolution x,320\nResolution y,240\n"
        "Bytes per pixel,2\n\nIntrinsic:,\nFx,307\nFy,307\nPPx,160\nPPy,120\n"
    )


def _kinect() -> None:
    _image(Path("color.jpg"), 480, 640)
    _codes(Path("depth.png"), 0.001, _metres(480, 640))


def _orbbec() -> None:
    _image(Path("color.png"))
    _codes(Path("depth.png"), 0.0001)


def _oak() -> None:
    _image(Path("rectified.png"), 400, 640)
    depth = _metres(400, 640)
    shift = np.divide(451 * 0.075 * 8, depth, out=np.zeros_like(depth), where=depth > 0)
    _codes(Path("disparity.png"), 1.0, shift)


def _zed() -> None:
    _image(Path("left.png"))
    _pfm(Path("depth.pfm"), np.where(_metres() > 0, _metres(), np.nan))


def _iphone() -> None:
    _image(Path("frame.jpg"), 4 * HEIGHT, 4 * WIDTH)
    Image.fromarray(_metres().astype(np.float32)).save("depth.tiff")
    levels = np.where(_metres() > 2, 1, 2).astype(np.uint8)
    Image.fromarray(levels).save("confidence.png")


def _tum() -> None:
    lines = []
    for index in range(2):
        image, depth = f"rgb/130503{index}.528748.png", f"depth/130503{index}.628784.png"
        _image(Path(image))
        _codes(Path(depth), 1 / 5000)
        lines.append(f"130503{index}.528748 {image} 130503{index}.628784 {depth}\n")
    Path("associations.txt").write_text("# colour, depth\n" + "".join(lines))


def _scannet() -> None:
    _image(Path("color/0.jpg"), 968, 1296)
    _codes(Path("depth/0.png"), 0.001, _metres(480, 640))
    Path("intrinsic").mkdir()
    for name, numbers in (("color", (1170, 1170, 647, 483)), ("depth", (577, 577, 319, 239))):
        fx, fy, cx, cy = numbers
        text = f"{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1\n"
        Path(f"intrinsic/intrinsic_{name}.txt").write_text(text)
    identity = "\n".join(" ".join(map(str, row)) for row in np.eye(4).tolist())
    Path("intrinsic/extrinsic_depth.txt").write_text(identity)


def _sunrgbd() -> None:
    _image(Path("image.jpg"))
    codes = np.rint(_metres() * 1000).astype(np.uint16)
    Image.fromarray(codes << 3 | codes >> 13).save("depth.png")


def _kitti() -> None:
    for index in range(2):
        _image(Path(f"image_02/{index:010d}.png"), 188, 620)
        _codes(Path(f"velodyne_raw/{index:010d}.png"), 1 / 256, _metres(188, 620))
    Path("calib_cam_to_cam.txt").write_text(
        "calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 6.20e+02 1.88e+02\n"
        "P_rect_02: 360 0 305 22 0 360 86 0.1 0 0 1 0.003\n"
    )


def _hypersim() -> None:
    h5py = pytest.importorskip("h5py")
    height, width = 768, 1024
    _image(Path("frame.0000.color.jpg"), height, width)
    y, x = np.mgrid[0:height, 0:width]
    ray = np.sqrt(1 + ((x - 511.5) / 886.81) ** 2 + ((y - 383.5) / 886.81) ** 2)
    with h5py.File("frame.0000.depth_meters.hdf5", "w") as file:
        file["dataset"] = (_metres(height, width) * ray).astype(np.float16)


def _middlebury() -> None:
    _image(Path("im0.png"))
    _pfm(Path("disp0.pfm"), np.where(_metres() > 0, 120 * 0.193001 * _inverse(), np.inf))
    Path("calib.txt").write_text(
        f"cam0=[120 0 64; 0 120 48; 0 0 1]\ncam1=[120 0 64; 0 120 48; 0 0 1]\ndoffs=0\n"
        f"baseline=193.001\nwidth={WIDTH}\nheight={HEIGHT}\nndisp=70\n"
    )


def _distorted() -> None:
    _image(Path("image.png"))
    _codes(Path("depth.png"), 0.001)
    Path("camera_info.yaml").write_text(
        f"image_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [120, 0, 63.5, 0, 120, 47.5, 0, 0, 1]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0, 0, 0]\n"
    )


def _shards() -> None:
    _image(Path("image.png"))
    _codes(Path("depth.png"), 0.001)
    Path("shards").mkdir()
    with tarfile.open("shards/000.tar", "w") as tar:
        tar.add("image.png", "frame.png")
        tar.add("depth.png", "frame.depth.png")


# a word that only this line has, and what makes its files
MADE_BY: dict[str, Callable[[], None]] = {
    "aligned_depth.png": _realsense,
    "shot_Depth.raw": _realsense_viewer,
    "585,585": _kinect,
    "0.0001": _orbbec,
    "rectified.png": _oak,
    "depth.pfm": _zed,
    "confidence.png": _iphone,
    "associations.txt": _tum,
    "intrinsic_depth.txt": _scannet,
    "sunrgbd": _sunrgbd,
    "velodyne_raw/": _kitti,
    "hdf5": _hypersim,
    "disp0.pfm": _middlebury,
    "--undistort": _distorted,
    "shards/": _shards,
}


def _maker(line: str) -> Callable[[], None]:
    (maker,) = [maker for word, maker in MADE_BY.items() if word in line]
    return maker


def test_each_line_has_its_files() -> None:
    assert {_maker(line) for line in LINES} == set(MADE_BY.values())


@pytest.mark.parametrize("line", LINES)
def test_each_line_runs(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Measured pixels keep their depth, so a wrong unit or encoding would show."""
    monkeypatch.chdir(tmp_path)
    _maker(line)()
    arguments = [*shlex.split(line)[1:], "--preset", "fast", "--resolution", "128"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    output = Path(arguments[arguments.index("-o") + 1])
    outputs = sorted(output.glob("[!.]*")) if output.is_dir() else [output]
    assert outputs
    for path in outputs:
        depth = read_depth(path).depth
        middle = depth[depth.shape[0] // 2 :, depth.shape[1] // 2]
        assert 1.1 < float(depth.median()) < 3.5
        # at the border of what was measured the answer is free to differ
        assert float(middle.quantile(0.05)) == pytest.approx(1.6, rel=0.1)
