"""What is written of a frame, and what is refused before anything is."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from steered_marigold.core.frame import Frame
from steered_marigold.core.notices import Notices
from steered_marigold.errors import InputError
from steered_marigold.frames.complete import complete_frame
from steered_marigold.frames.outputs import Outputs, save
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.point_clouds import read_point_cloud
from steered_marigold.methods.completer import DepthCompleter
from tests.frames.completers import NearestCompleter, SilentCompleter

K = torch.tensor([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]])


@pytest.fixture
def frame(frame_files: tuple[Path, Path]) -> Frame:
    """The frame of the files, with intrinsics."""
    image, depth = frame_files
    return replace(read_frame(FrameFiles(image=image, depth=depth), Reading()), K=K)


def _save(
    completer: DepthCompleter, frame: Frame, *, output_scale: float | None = None, **outputs: Path
) -> tuple[dict[str, Any], Notices]:
    completion, _ = complete_frame(completer, frame, no_measurements=True)
    return save(completion, frame, Outputs(**outputs), output_scale=output_scale)


def test_everything_asked_for_is_written_and_recorded(
    completer: NearestCompleter, frame: Frame, tmp_path: Path
) -> None:
    completion, _ = complete_frame(completer, frame)
    outputs = Outputs(
        depth=tmp_path / "out.npy",
        uncertainty=tmp_path / "sure.exr",
        visualization=tmp_path / "panels.png",
        point_cloud=tmp_path / "cloud.ply",
    )
    record, notices = save(completion, frame, outputs)
    depth = np.load(tmp_path / "out.npy")
    assert np.array_equal(depth, completion.depth[0])
    assert completion.uncertainty is not None
    assert torch.equal(read_depth(tmp_path / "sure.exr").depth, completion.uncertainty[0])
    assert record["points"] == len(read_point_cloud(tmp_path / "cloud.ply").points) == depth.size
    assert record == {
        "output": str(tmp_path / "out.npy"),
        "uncertainty": str(tmp_path / "sure.exr"),
        "visualization": str(tmp_path / "panels.png"),
        "point_cloud": str(tmp_path / "cloud.ply"),
        "unrepresentable": 0,
        "points": depth.size,
    }
    assert notices == ()
    assert np.asarray(Image.open(tmp_path / "panels.png")).std() > 5


def test_the_same_answer_gives_the_same_bytes(
    completer: NearestCompleter, frame: Frame, tmp_path: Path
) -> None:
    for name in "ab":
        _save(
            completer,
            frame,
            depth=tmp_path / f"{name}.png",
            uncertainty=tmp_path / f"{name}.npy",
            visualization=tmp_path / f"{name}_panels.png",
            point_cloud=tmp_path / f"{name}.ply",
        )
    for ending in (".png", ".npy", "_panels.png", ".ply"):
        first, second = ((tmp_path / f"{name}{ending}").read_bytes() for name in "ab")
        assert first == second


def test_unknown_depth_is_in_no_file(
    completer: NearestCompleter, frame: Frame, tmp_path: Path
) -> None:
    completion, _ = complete_frame(completer, frame, max_uncertainty=0.01)
    outputs = Outputs(depth=tmp_path / "out.png", point_cloud=tmp_path / "cloud.ply")
    record, _ = save(completion, frame, outputs)
    known = completion.depth[0] > 0
    assert torch.equal(read_depth(tmp_path / "out.png").valid_mask, known)
    assert record["points"] == int(known.sum()) < known.numel()
    assert record["unrepresentable"] == 0


def test_depth_that_does_not_fit_is_counted_and_told(
    completer: NearestCompleter, frame: Frame, tmp_path: Path
) -> None:
    out = tmp_path / "out.png"
    record, notices = _save(completer, frame, output_scale=0.00005, depth=out)
    assert record["unrepresentable"] == int((read_depth(out).depth == 0).sum()) > 0
    assert [notice.kind for notice in notices] == ["unrepresentable"]
    assert f"{out}: {record['unrepresentable']} depths do not fit" in notices[0].text
    assert ".npy, .tiff and .exr hold them, or another `output_scale`" in notices[0].text


def test_relative_depth_takes_all_of_a_png(
    completer: NearestCompleter, frame: Frame, tmp_path: Path
) -> None:
    nothing = frame.keep(torch.zeros_like(frame.valid_mask))
    _save(completer, nothing, depth=tmp_path / "out.png")
    codes = np.asarray(Image.open(tmp_path / "out.png"))
    relative = frame.image.float().mean(dim=2).numpy() / 255
    assert np.abs(codes - relative * 65535).max() <= 1


def test_what_cannot_be_had_leaves_no_file_at_all(
    completer: NearestCompleter,
    silent_completer: SilentCompleter,
    frame: Frame,
    tmp_path: Path,
) -> None:
    out, cloud = tmp_path / "out.png", tmp_path / "cloud.ply"
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match="`ensemble_size=4`"):
        _save(silent_completer, frame, depth=out, uncertainty=tmp_path / "sure.npy")
    with pytest.raises(InputError, match="`point_cloud` needs `intrinsics`"):
        _save(completer, replace(frame, K=None), depth=out, point_cloud=cloud)
    nothing = frame.keep(torch.zeros_like(frame.valid_mask))
    with pytest.raises(InputError, match=r"`point_cloud` needs .* metric depth"):
        _save(completer, nothing, depth=out, point_cloud=cloud)
    with pytest.raises(InputError, match="cannot be written"):
        _save(completer, frame, depth=out, visualization=tmp_path / "missing" / "panels.png")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("outputs", "scale", "problem"),
    [
        ({"depth": "o.jpg"}, None, "unknown extension '.jpg'"),
        ({"depth": "o"}, None, "unknown extension ''"),
        ({"visualization": "v.jpg"}, None, "'.jpg'"),
        ({"uncertainty": "u.ply"}, None, "'.ply'"),
        ({"point_cloud": "c.pcd"}, None, "'.pcd'"),
        ({"depth": "o.npy"}, 0.01, "`output_scale` is for .png"),
        ({}, 0.0, "`output_scale` must be"),
        ({}, float("nan"), "`output_scale` must be"),
    ],
)
def test_outputs_that_there_are_not(
    outputs: dict[str, str], scale: float | None, problem: str
) -> None:
    paths = {name: Path(file) for name, file in ({"depth": "o.png"} | outputs).items()}
    with pytest.raises(InputError) as caught:
        Outputs(**paths).require_possible(has_K=True, output_scale=scale)
    assert problem in str(caught.value)


def test_a_point_cloud_needs_a_camera() -> None:
    outputs = Outputs(depth=Path("o.png"), point_cloud=Path("c.ply"))
    outputs.require_possible(has_K=True, output_scale=0.002)
    with pytest.raises(InputError, match="`point_cloud` needs the camera: give `intrinsics`"):
        outputs.require_possible(has_K=False, output_scale=None)


def test_outputs_never_hit_inputs_or_each_other(frame_files: tuple[Path, Path]) -> None:
    image, depth = frame_files
    inputs = FrameFiles(image=image, depth=depth)
    with pytest.raises(InputError, match="is an input"):
        Outputs(depth=depth.parent / "." / depth.name).require_distinct(inputs)
    out = depth.parent / "out.png"
    with pytest.raises(InputError, match="named twice"):
        Outputs(depth=out, visualization=out).require_distinct(inputs)
    Outputs(depth=out, visualization=depth.parent / "v.png").require_distinct(inputs)


def test_folders_hold_a_frames_files_under_its_name(tmp_path: Path) -> None:
    folders = Outputs(depth=tmp_path, uncertainty=tmp_path / "u", point_cloud=tmp_path / "c")
    assert folders.of_frame("7", ".npy") == Outputs(
        depth=tmp_path / "7.npy",
        uncertainty=tmp_path / "u" / "7.npy",
        point_cloud=tmp_path / "c" / "7.ply",
    )
    mixed = Outputs(depth=tmp_path, visualization=tmp_path / "v.png")
    assert mixed.in_folders("7", ".exr") == replace(mixed, depth=tmp_path / "7.exr")
