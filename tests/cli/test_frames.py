"""One frame from files to files, with a completer that needs no checkpoint."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from steered_marigold.cli.frames import Completer, complete_frame, read_frame
from steered_marigold.cli.settings import Inputs, Outputs, Settings, require_consistent

from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from steered_marigold.io.depth_maps import read_depth
from steered_marigold.io.point_clouds import read_point_cloud

K = torch.tensor([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]])


def _run(
    completer: Completer, files: tuple[Path, Path | None], settings: Settings, **outputs: Path
) -> dict[str, Any]:
    inputs = Inputs(image=files[0], depth=files[1])
    asked = Outputs(**({"depth": files[0].parent / "out.png"} | outputs))
    require_consistent(inputs, asked, settings)
    asked.require_distinct(inputs)
    return complete_frame(completer, read_frame(inputs, settings), inputs, asked, settings)


def test_everything_asked_for_is_written_and_recorded(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    record = _run(
        completer,
        frame_files,
        Settings(K=K, seed=3),
        depth=tmp_path / "out.npy",
        uncertainty=tmp_path / "sure.exr",
        visualization=tmp_path / "panels.png",
        point_cloud=tmp_path / "cloud.ply",
    )
    depth = np.load(tmp_path / "out.npy")
    measured = read_depth(frame_files[1])
    assert (depth > 0).all()
    assert np.abs(depth - measured.depth.numpy())[measured.valid_mask].max() <= 1e-3
    assert record["input_valid_fraction"] == pytest.approx(measured.valid_mask.float().mean())
    assert (record["depth_min_m"], record["depth_max_m"]) == (depth.min(), depth.max())
    assert (record["metric"], record["scale"], record["shift"]) == (True, 4.0, 0.5)
    assert (record["seed"], record["steps"], record["dtype"]) == (3, 1, "float32")
    assert (record["trusted"], record["untrusted"]) == (int(measured.valid_mask.sum()), 0)
    assert record["points"] == len(read_point_cloud(tmp_path / "cloud.ply").points) == depth.size
    assert record["treated_as_missing"]["zero"] == measured.missing["zero"]
    for name in ("output", "uncertainty", "visualization", "point_cloud"):
        assert Path(record[name]).stat().st_size > 0
    json.dumps(record, allow_nan=False)


def test_a_seed_gives_the_same_bytes_and_another_seed_others(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        _run(completer, frame_files, Settings(seed=seed), depth=tmp_path / f"{name}.npy")
    a, b, c = ((tmp_path / f"{name}.npy").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_what_is_too_uncertain_is_unknown_everywhere(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    record = _run(
        completer,
        frame_files,
        Settings(K=K, max_uncertainty=0.01),
        uncertainty=tmp_path / "sure.npy",
        point_cloud=tmp_path / "cloud.ply",
    )
    unsure = np.load(tmp_path / "sure.npy") > 0.01
    back = read_depth(tmp_path / "out.png")
    assert 0 < record["too_uncertain"] == unsure.sum() < unsure.size
    assert np.array_equal(back.valid_mask, ~unsure)
    assert record["points"] == (~unsure).sum()
    assert record["unrepresentable"] == 0


def test_uncertainty_that_nobody_estimated_cannot_be_had(
    silent_completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="--ensemble"):
        _run(silent_completer, frame_files, Settings(max_uncertainty=0.1))
    with pytest.raises(InputError, match="--ensemble"):
        _run(silent_completer, frame_files, Settings(), uncertainty=tmp_path / "sure.npy")
    assert not (tmp_path / "out.png").exists()
    record = _run(silent_completer, frame_files, Settings())
    assert (record["scale"], record["shift"], record["floored"]) == (None, None, 0)


def test_depth_that_does_not_fit_is_counted_and_named(
    completer: Completer, frame_files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    record = _run(completer, frame_files, Settings(output_scale=0.00005))
    assert record["unrepresentable"] == int((read_depth(record["output"]).depth == 0).sum()) > 0
    assert ".npy, .tiff and .exr hold them" in capsys.readouterr().err


def test_confidence_is_passed_on(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    image, depth = frame_files
    codes = np.full((24, 32), 255, np.uint8)
    codes[:, :16] = 0
    Image.fromarray(codes).save(tmp_path / "confidence.png")
    inputs = Inputs(image=image, depth=depth, confidence=tmp_path / "confidence.png")
    frame = read_frame(inputs, Settings())
    outputs = Outputs(depth=tmp_path / "out.png")
    record = complete_frame(completer, frame, inputs, outputs, Settings())
    assert record["untrusted"] == int(frame.valid_mask[:, :16].sum()) > 0

    Image.fromarray(codes[:-1]).save(tmp_path / "confidence.png")
    with pytest.raises(SizeMismatchError, match=r"32x23 but .* 32x24"):
        read_frame(inputs, Settings())


def test_a_registered_depth_map_moves_to_the_grid_of_the_image(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    image, depth = frame_files
    Image.open(image).resize((96, 72)).save(image)
    confidence = torch.rand(24, 32, generator=torch.Generator().manual_seed(0)).numpy()
    np.save(tmp_path / "confidence.npy", confidence)
    inputs = Inputs(image=image, depth=depth, confidence=tmp_path / "confidence.npy")
    with pytest.raises(SizeMismatchError, match=r"96x72.*32x24.*--depth-grid registered"):
        read_frame(inputs, Settings())
    frame = read_frame(inputs, Settings(registered=True))
    centres = (slice(1, None, 3), slice(1, None, 3))
    measured = read_depth(depth)
    assert torch.equal(frame.depth[centres], measured.depth)
    assert int(frame.valid_mask.sum()) == int(measured.valid_mask.sum())
    assert frame.confidence is not None
    kept = frame.confidence[centres][measured.valid_mask]
    assert np.array_equal(kept, confidence[measured.valid_mask.numpy()])
    Image.open(image).resize((96, 96)).save(image)
    with pytest.raises(SizeMismatchError, match="aspect ratio"):
        read_frame(inputs, Settings(registered=True))


def test_an_exif_orientation_must_fit_the_depth(frame_files: tuple[Path, Path]) -> None:
    image, depth = frame_files
    picture = Image.open(image)
    upright = np.array(picture)
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(image, exif=exif)
    inputs = Inputs(image=image, depth=depth)
    with pytest.raises(SizeMismatchError, match=r"24x32 but .* 32x24.*EXIF"):
        read_frame(inputs, Settings())
    Image.fromarray(np.rot90(upright)).save(image, exif=exif)
    assert np.array_equal(read_frame(inputs, Settings()).image, upright)


def test_nothing_measured(
    completer: Completer, frame_files: tuple[Path, Path], tmp_path: Path
) -> None:
    image, depth = frame_files
    Image.fromarray(np.full((24, 32), 65535, np.uint16)).save(depth)
    with pytest.raises(NoMeasurementsError, match=r"no valid pixel.*768 saturated.*--no-meas"):
        _run(completer, (image, depth), Settings())
    relative = np.asarray(Image.open(image)).mean(axis=2) / 255
    for files in ((image, depth), (image, None)):
        record = _run(completer, files, Settings(no_measurements=True))
        assert (record["metric"], record["depth_min_m"], record["scale"]) == (False, None, None)
        codes = np.asarray(Image.open(record["output"]))
        assert np.abs(codes - relative * 65535).max() <= 1
        json.dumps(record, allow_nan=False)
    with pytest.raises(InputError, match="relative"):
        _run(completer, (image, depth), Settings(no_measurements=True, max_uncertainty=1.0))
    with pytest.raises(InputError, match="relative"):
        _run(
            completer,
            (image, None),
            Settings(no_measurements=True, K=K),
            point_cloud=tmp_path / "cloud.ply",
        )


def test_permission_to_do_without_measurements_does_not_drop_them(
    completer: Completer, frame_files: tuple[Path, Path]
) -> None:
    assert _run(completer, frame_files, Settings(no_measurements=True))["metric"]


@pytest.mark.parametrize("metres", [0.002, 900.0])
def test_an_implausible_scale_is_a_warning(
    frame_files: tuple[Path, Path], capsys: pytest.CaptureFixture[str], metres: float
) -> None:
    image, depth = frame_files
    read_frame(Inputs(image=image, depth=depth), Settings(depth_scale=metres / 2700))
    assert "--depth-scale" in capsys.readouterr().err


def test_arguments_that_contradict_each_other(tmp_path: Path) -> None:
    frame = Inputs(image=Path("a.jpg"), depth=Path("a.png"))
    depth = Outputs(depth=Path("out.png"))
    cases: list[tuple[Inputs, Outputs, Settings, str]] = [
        (frame, Outputs(depth=Path("o.jpg")), Settings(), "unknown extension '.jpg'"),
        (frame, Outputs(depth=Path("o")), Settings(), "unknown extension ''"),
        (frame, Outputs(depth=Path("o.png"), visualization=Path("v.jpg")), Settings(), "'.jpg'"),
        (frame, Outputs(depth=Path("o.png"), uncertainty=Path("u.ply")), Settings(), "'.ply'"),
        (frame, Outputs(depth=Path("o.png"), point_cloud=Path("c.pcd")), Settings(K=K), "'.pcd'"),
        (frame, Outputs(depth=Path("o.png"), point_cloud=Path("c.ply")), Settings(), "--intrin"),
        (frame, Outputs(depth=Path("o.npy")), Settings(output_scale=0.01), "is for .png"),
        (frame, depth, Settings(output_scale=0.0), "--output-scale must be"),
        (frame, depth, Settings(depth_scale=-1.0), "--depth-scale must be"),
        (frame, depth, Settings(max_depth=0.0), "--max-depth must be"),
        (frame, depth, Settings(max_uncertainty=float("nan")), "--max-uncertainty must be"),
        (Inputs(image=Path("a.jpg")), depth, Settings(), "DEPTH is missing"),
        (
            Inputs(image=Path("a.jpg"), confidence=Path("c.png")),
            depth,
            Settings(no_measurements=True),
            "--confidence",
        ),
    ]
    for inputs, outputs, settings, problem in cases:
        with pytest.raises(InputError) as caught:
            require_consistent(inputs, outputs, settings)
        assert problem in str(caught.value)


def test_outputs_never_hit_inputs_or_each_other(frame_files: tuple[Path, Path]) -> None:
    image, depth = frame_files
    inputs = Inputs(image=image, depth=depth)
    with pytest.raises(InputError, match="is an input"):
        Outputs(depth=depth.parent / "." / depth.name).require_distinct(inputs)
    out = depth.parent / "out.png"
    with pytest.raises(InputError, match="named twice"):
        Outputs(depth=out, visualization=out).require_distinct(inputs)
