"""K from text."""

from pathlib import Path

import numpy as np
import pytest
import torch

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.intrinsics import read_intrinsics

EXPECTED = [[460.5, 0, 319.5], [0, 461.25, 239.5], [0, 0, 1]]


def test_four_numbers() -> None:
    assert read_intrinsics("460.5,461.25,319.5,239.5").K.tolist() == EXPECTED
    assert read_intrinsics(" 460.5, 461.25, 319.5, 239.5 ").K.tolist() == EXPECTED


@pytest.mark.parametrize(
    "text",
    [
        "460.5 0.0 319.5\n0.0 461.25 239.5\n0.0 0.0 1.0",
        "4.605e2\t0 319.5\r\n0 461.25 239.5\r\n0 0 1\r\n\r\n",
        "[[460.5, 0, 319.5], [0, 461.25, 239.5], [0, 0, 1]]",
        "460.5,0,319.5;0,461.25,239.5;0,0,1",
        "460.5 461.25 319.5 239.5\n",
    ],
)
def test_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    assert read_intrinsics(tmp_path / "K.txt").K.tolist() == EXPECTED


@pytest.mark.parametrize(
    "text",
    ["", "1 2 3", "fx 460", "460 0 320 0 460 240 0 0 2", "0 460 320 240", "nan 460 320 240"],
)
def test_files_that_are_no_camera(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    with pytest.raises(FileFormatError, match=r"K\.txt"):
        read_intrinsics(tmp_path / "K.txt")


def test_arguments_that_are_no_camera(tmp_path: Path) -> None:
    for text in ("460,460,320", "-460,460,320,240"):
        with pytest.raises(FileFormatError, match=text):
            read_intrinsics(text)
    with pytest.raises(FileFormatError, match="no such file"):
        read_intrinsics(tmp_path / "K.txt")
    (tmp_path / "K.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="damaged"):
        read_intrinsics(tmp_path / "K.txt")


def test_an_array(tmp_path: Path) -> None:
    np.save(tmp_path / "K.npy", np.array(EXPECTED))
    assert read_intrinsics(tmp_path / "K.npy").K.tolist() == EXPECTED


def test_real_frames(real_frames: Path) -> None:
    files = sorted(real_frames.glob("*/intrinsics.txt"))
    assert files
    for file in files:
        K = read_intrinsics(file).K
        assert 300 < float(K[0, 0]) < 700
        assert 200 < float(K[1, 2]) < 300


SIZED = (480, 640)


@pytest.mark.parametrize(
    "text",
    [
        "# fx fy cx cy\n460.5 461.25 319.5 239.5\n",
        "460.5 461.25 319.5 239.5  # pixels\n",
        "460.5 0 319.5 0\n0 461.25 239.5 0\n0 0 1 0\n0 0 0 1\n",
        "P0: 1 0 1 0 0 1 1 0 0 0 1 0\nP2: 460.5 0 319.5 44.8 0 461.25 239.5 0.2 0 0 1 0.003\n"
        "Tr_velo_to_cam: 1 2 3\n",
        "calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 6.4e+02 4.8e+02\n"
        "P_rect_02: 460.5 0 319.5 44.8 0 461.25 239.5 0.2 0 0 1 0.003\n",
        "460.5 461.25 319.5 239.5 640 480",
        "460.5 0 319.5\n0 461.25 239.5\n0 0 1\n640 480\n",
        "# Camera list\n1 PINHOLE 640 480 460.5 461.25 320 240\n"
        "2 PINHOLE 640 480 460.5 461.25 320 240",
        '{"width":640,"height":480,"intrinsic_matrix":[460.5,0,0,0,461.25,0,319.5,239.5,1]}',
        '{"intrinsic":{"width":640,"height":480,"intrinsic_matrix":'
        '[460.5,0,0,0,461.25,0,319.5,239.5,1]},"extrinsic":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}',
        '{"width":640,"height":480,"ppx":319.5,"ppy":239.5,"fx":460.5,"fy":461.25,'
        '"model":"distortion.brown_conrady","coeffs":[0,0,0,0,0]}',
        '{"w":640,"h":480,"K":[460.5,0,0,0,461.25,0,319.5,239.5,1]}',
        '{"K": [[460.5,0,319.5],[0,461.25,239.5],[0,0,1]]}',
        '{"fl_x":460.5,"fl_y":461.25,"cx":319.5,"cy":239.5,"w":640,"h":480,"frames":[]}',
        "image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n"
        "  cols: 3\n  data: [460.5, 0., 319.5, 0., 461.25, 239.5, 0., 0., 1.]\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n",
        "header:\n  frame_id: camera\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
        "d:\n- 0.0\n- 0.0\nk:\n- 460.5\n- 0.0\n- 319.5\n- 0.0\n- 461.25\n- 239.5\n- 0.0\n- 0.0\n"
        "- 1.0\n"
        "---\n",
        "cam0:\n  camera_model: pinhole\n  intrinsics: [460.5, 461.25, 319.5, 239.5]\n"
        "  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n  resolution: [640, 480]\n",
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 460.5, 0., 319.5, 0., 461.25, 239.5, 0., 0., 1. ]\n",
        'File.version: "1.0"\nCamera.type: "PinHole"\nCamera1.fx: 460.5\nCamera1.fy: 461.25\n'
        "Camera1.cx: 319.5\nCamera1.cy: 239.5\nCamera1.k1: 0.0\nCamera.width: 640\n"
        "Camera.height: 480\nCamera.fps: 30\n",
        "colorHeight = 480\ncolorWidth = 640\nfx_color = 460.5\nfy_color = 461.25\n"
        "mx_color = 319.5\nmy_color = 239.5\nsceneType = Apartment\n",
        "cam0=[460.5 0 319.5; 0 461.25 239.5; 0 0 1]\n"
        "cam1=[460.5 0 400; 0 461.25 239.5; 0 0 1]\n"
        "doffs=0\nbaseline=193.001\nwidth=640\nheight=480\nndisp=280\n",
        "Frame Info: \nType,Color\nResolution x,640\nResolution y,480\n\nIntrinsic:,\nFx,460.5\n"
        "Fy,461.25\nPPx,319.5\nPPy,239.5\nDistorsion,Inverse Brown Conrady\n",
    ],
)  # fmt: skip
def test_camera_files_of_every_form(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.txt").write_text(text)
    camera = read_intrinsics(tmp_path / "camera.txt")
    assert camera.K.tolist() == EXPECTED
    assert camera.distortion is None
    assert camera.size in (None, SIZED)
    if "640" in text or "6.4e+02" in text:
        assert camera.size == SIZED


@pytest.mark.parametrize(
    ("text", "coefficients"),
    [
        ("460.5 461.25 319.5 239.5 0.25 -0.5 0.125 0.0625 1.5", (0.25, -0.5, 0.125, 0.0625, 1.5)),
        ("460.5 461.25 319.5 239.5 0.25 -0.5 0.125 0.0625", (0.25, -0.5, 0.125, 0.0625)),
        ("1 OPENCV 640 480 460.5 461.25 320 240 0.25 -0.5 0.125 0.0625",
         (0.25, -0.5, 0.125, 0.0625)),
        ("K: [460.5, 0, 319.5, 0, 461.25, 239.5, 0, 0, 1]\nD: [0.25, -0.5, 0.125, 0.0625, 0]\n",
         (0.25, -0.5, 0.125, 0.0625, 0)),
        ('{"fl_x":460.5,"fl_y":461.25,"cx":319.5,"cy":239.5,"k1":0.25,"k2":-0.5,"p1":0.125,'
         '"p2":0.0625}', (0.25, -0.5, 0.125, 0.0625, 0)),
    ],
)  # fmt: skip
def test_distortion_is_kept(tmp_path: Path, text: str, coefficients: tuple[float, ...]) -> None:
    (tmp_path / "camera.txt").write_text(text)
    camera = read_intrinsics(tmp_path / "camera.txt")
    assert camera.K.tolist() == EXPECTED
    assert camera.distortion == coefficients


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1 PINHOLE 640 480 1 2 3 4\n2 PINHOLE 640 480 1 2 3 5\n", "2 cameras that differ"),
        ("1 FOV 640 480 460 460 320 240 0.1\n", "COLMAP model FOV"),
        ("1 PINHOLE 640 480 460 460 320\n", "4 parameters"),
        ("K: [460, 0, 320, 0, 460, 240, 0, 0, 1]\ndistortion_model: equidistant\n", "equidistant"),
        ("{", "no JSON"),
        ("a: [1", "neither numbers nor YAML"),
        ("hello: world", "no camera matrix"),
        ("fx: 460", "no cx or cy"),
        ("1 2 3 4 5", "5 numbers"),
        ("just words", "none of them"),
        # found by tests/faults
        (f"460 0 325\n0 46{'1' * 40}.5 241\n0 0 1\n", "not finite, or no float32"),
        ('{"fx": 400, "cx": NaN, "cy": 2}', "not finite"),
        ("K: [460, 0, 320, 0, 460, 240, 0, 0, 1]\nD: [.nan, 0, 0, 0]\n", "not finite"),
        ('{"fx": "abc", "cx": 1, "cy": 2}', "could not convert"),
        ('{"fx": 400, "cx": 1, "cy": 2, "width": 1e999, "height": 3}', "infinity"),
        ('{"fx": 400, "cx": 1, "cy": 2, "width": 640, "height": 1e-3}', "no number of pixels"),
        ('{"fx": 400, "cx": 1, "cy": 2, "k1": [1]}', "damaged"),
    ],
)
def test_what_is_wrong_with_a_camera_file_is_said(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "camera.txt").write_text(text)
    with pytest.raises(FileFormatError, match=rf"camera\.txt: .*{problem}"):
        read_intrinsics(tmp_path / "camera.txt")


def test_half_a_pixel_and_the_offset_of_disparities_are_told(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 640 480 460 320 240\n")
    camera = read_intrinsics(tmp_path / "cameras.txt")
    assert camera.K[:2, 2].tolist() == [319.5, 239.5]
    assert [note.kind for note in camera.notes] == ["half_pixel"]
    (tmp_path / "calib.txt").write_text("cam0=[460 0 320; 0 460 240; 0 0 1]\ndoffs=131.1\n")
    assert "doffs = 131.1" in read_intrinsics(tmp_path / "calib.txt").notes[0].text


def test_k_of_another_resolution_is_scaled_if_its_size_is_known() -> None:
    K, notes = read_intrinsics("460.5,461.25,319.5,239.5,640,480").for_image((960, 1280))
    assert K.tolist() == [[921, 0, 639.5], [0, 922.5, 479.5], [0, 0, 1]]
    assert [note.kind for note in notes] == ["intrinsics_scaled"]
    same, nothing = read_intrinsics("460.5,461.25,319.5,239.5,640,480").for_image(SIZED)
    assert same.tolist() == EXPECTED
    assert nothing == ()
    with pytest.raises(InputError, match="1280x720 px, another aspect ratio"):
        read_intrinsics("900,900,640,360,1280,720").for_image(SIZED)


def test_normalised_k_is_scaled() -> None:
    camera = read_intrinsics("0.72,0.96,0.5,0.5")
    assert camera.normalised
    K, notes = camera.for_image(SIZED)
    torch.testing.assert_close(K[:2, 2], torch.tensor([319.5, 239.5]))
    torch.testing.assert_close(K.diagonal(), torch.tensor([460.8, 460.8, 1]))
    assert "normalised" in notes[0].text


@pytest.mark.parametrize("source", ["1380,1380,960,540", "900,900,640,360", "460,460,-9,240"])
def test_a_principal_point_outside_the_image_is_refused(source: str) -> None:
    with pytest.raises(InputError, match=r"principal point .* outside .*append its width"):
        read_intrinsics(source).for_image(SIZED)


def test_a_principal_point_far_from_the_middle_is_doubted() -> None:
    K, notes = read_intrinsics("230,230,160,120").for_image(SIZED)
    assert K[0, 2] == 160
    assert [note.kind for note in notes] == ["intrinsics_off_centre"]
