"""steered-marigold complete: a frame's files, or two folders of them, to dense metric depth."""

import json
import sys
from enum import StrEnum
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer
from typer import Argument, Option

from steered_marigold.cli.messages import say
from steered_marigold.errors import InputError

_WRITE, _READ, _METHOD = "What to write", "How to read the files", "How to complete"
_PRESETS = "the preset's"


class DepthGrid(StrEnum):
    """How the depth map's pixels relate to the image's."""

    SAME = "same"
    REGISTERED = "registered"


class Dtype(StrEnum):
    """What the model computes in; auto: what the device has matrix instructions for."""

    AUTO = "auto"
    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"
    FLOAT16 = "float16"


def _write(*names: str, **kwargs: Any) -> Any:
    return Option(*names, rich_help_panel=_WRITE, **kwargs)


def _read(*names: str, **kwargs: Any) -> Any:
    return Option(*names, rich_help_panel=_READ, **kwargs)


def _method(*names: str, **kwargs: Any) -> Any:
    return Option(*names, rich_help_panel=_METHOD, **kwargs)


def complete(
    image: Annotated[Path, Argument(help="An image, or a folder of them.")],
    depth: Annotated[
        Path | None,
        Argument(
            help="Its incomplete depth (.png of 16 bits, .tiff, .npy, .exr; 0 = missing), or a "
            "folder of depth maps with the stems of the images."
        ),
    ] = None,
    *,
    output: Annotated[
        Path | None,
        _write(
            "-o",
            "--output",
            help=".png (uint16 millimetres), .npy, .tiff or .exr (float32 metres); for folders a "
            "folder.",
            show_default="IMAGE_completed.png, or completed/",
        ),
    ] = None,
    output_scale: Annotated[
        float | None, _write(help="Metres per unit of a .png output.", show_default="0.001")
    ] = None,
    output_format: Annotated[
        str, _write(help="Of a folder's depth and uncertainty: png, npy, tiff or exr.")
    ] = "png",
    uncertainty: Annotated[Path | None, _write(help="The error's standard deviation [m].")] = None,
    visualization: Annotated[
        Path | None, _write(help="A .png of image, input, result and uncertainty.")
    ] = None,
    point_cloud: Annotated[
        Path | None, _write(help="A coloured .ply in metres; needs --intrinsics.")
    ] = None,
    max_uncertainty: Annotated[
        float | None,
        _write(help="Write 0 (unknown) where the uncertainty [m] is larger."),
    ] = None,
    as_json: Annotated[
        bool, _write("--json", help="Print one JSON record a frame on stdout, all else on stderr.")
    ] = False,
    overwrite: Annotated[
        bool, _write("--overwrite", help="Redo the frames of a folder that have their results.")
    ] = False,
    depth_scale: Annotated[
        float | None,
        _read(
            help="Metres per unit of DEPTH. KITTI needs 0.00390625.",
            show_default="0.001 for integers, 1 for floats",
        ),
    ] = None,
    max_depth: Annotated[
        float | None,
        _read(
            help="Measurements farther than these metres count as missing; the result is not cut."
        ),
    ] = None,
    depth_grid: Annotated[
        DepthGrid, _read(help="registered: DEPTH has a lower resolution and an equal view.")
    ] = DepthGrid.SAME,
    intrinsics: Annotated[
        str | None, _read(help="K of the image: a text file, or fx,fy,cx,cy in pixels.")
    ] = None,
    confidence: Annotated[
        Path | None,
        _read(help="Weights of the measurements: .png (white = 1) or .npy in 0..1, or a folder."),
    ] = None,
    sensor_noise: Annotated[
        str | None,
        _read(
            help="How closely measurements are met: metres, or per cent of depth as 1%.",
            show_default=_PRESETS,
        ),
    ] = None,
    no_measurements: Annotated[
        bool,
        _read("--no-measurements", help="Where nothing was measured, give relative depth."),
    ] = False,
    checkpoint: Annotated[
        str, _method(help="embedded, a folder, or a hub id in Marigold's format.")
    ] = "embedded",
    preset: Annotated[str, _method(help="default, fast (CPUs, live use) or paper.")] = "default",
    steps: Annotated[
        int | None, _method(min=1, help="Denoising steps.", show_default=_PRESETS)
    ] = None,
    steering_strength: Annotated[
        float | None, _method(min=0, help="The paper's lambda.", show_default=_PRESETS)
    ] = None,
    ensemble: Annotated[
        int | None, _method(min=1, help="Number of samples to merge.", show_default=_PRESETS)
    ] = None,
    resolution: Annotated[
        int | None,
        _method(
            min=0,
            help="Longest side inside the model in pixels, 0 = the image's own.",
            show_default="the checkpoint's",
        ),
    ] = None,
    seed: Annotated[int, _method(min=0, help="The same seed gives the same bytes.")] = 0,
    device: Annotated[
        str | None, _method(help="cpu, cuda, mps.", show_default="the best there is")
    ] = None,
    dtype: Annotated[
        Dtype | None,
        _method(
            help="What the model computes in; auto: what the device is fastest in.",
            show_default="auto, for preset paper float32",
        ),
    ] = None,
    compiled: Annotated[
        bool,
        _method("--compile", help="Compile the networks: minutes once, faster for many frames."),
    ] = False,
) -> None:
    """Complete the depth of a frame, or of two folders of frames.

    Depth is z along the optical axis, in metres. See docs/complete.md for cameras, conventions
    and the JSON record.
    """
    from steered_marigold.cli.folders import complete_folders, plan_folders
    from steered_marigold.cli.frames import complete_frame, read_frame
    from steered_marigold.cli.settings import Inputs, Outputs, Settings, require_consistent
    from steered_marigold.io.files import require_writable
    from steered_marigold.io.intrinsics import read_intrinsics

    inputs = Inputs(image=image, depth=depth, confidence=confidence)
    outputs = Outputs(
        depth=output or Path("completed" if image.is_dir() else f"{image.stem}_completed.png"),
        uncertainty=uncertainty,
        visualization=visualization,
        point_cloud=point_cloud,
    )
    settings = Settings(
        seed=seed,
        depth_scale=depth_scale,
        max_depth=max_depth,
        registered=depth_grid is DepthGrid.REGISTERED,
        K=None if intrinsics is None else read_intrinsics(intrinsics).K,
        no_measurements=no_measurements,
        max_uncertainty=max_uncertainty,
        output_scale=output_scale,
    )
    model = {
        "checkpoint": checkpoint,
        "preset": preset,
        "device": device,
        "dtype": None if dtype is None else dtype.value,
        "compiled": compiled,
        "num_inference_steps": steps,
        "steering_strength": steering_strength,
        "ensemble_size": ensemble,
        "processing_resolution": resolution,
        "sensor_noise": None if sensor_noise is None else _parse_sensor_noise(sensor_noise),
    }
    show = _print_json if as_json else _print_paths

    if not image.is_dir():
        require_consistent(inputs, outputs, settings)
        outputs.require_distinct(inputs)
        for path in outputs.asked().values():
            require_writable(path)
        frame = read_frame(inputs, settings)  # bad input is told before the model is loaded
        completer, load_seconds = _load(model, progress=sys.stderr.isatty())
        record = complete_frame(completer, frame, inputs, outputs, settings)
        show(record | {"load_seconds": load_seconds})
        return

    plan = plan_folders(inputs, outputs, settings, suffix=f".{output_format}", overwrite=overwrite)
    failures = 0
    if plan.frames:
        completer, load_seconds = _load(model, progress=False)
        failures = complete_folders(
            completer,
            plan.frames,
            settings,
            report=lambda record: show(record | {"load_seconds": load_seconds}),
        )
    done = len(plan.frames) - failures
    failures += plan.failed
    say(f"{done} completed, {plan.skipped} skipped, {failures} failed")
    if failures:
        raise typer.Exit(1)


def _parse_sensor_noise(text: str) -> Any:
    """A SensorNoise from metres, "0.01", or per cent of depth, "1%"."""
    try:
        amount = float(text.removesuffix("%"))
    except ValueError:
        amount = -1.0
    if not 0 <= amount < float("inf"):
        raise InputError(f"--sensor-noise {text}: give metres, as 0.01, or per cent, as 1%")
    from steered_marigold.core.consistency import SensorNoise

    return SensorNoise(fraction=amount / 100) if text.endswith("%") else SensorNoise(metres=amount)


def _load(model: dict[str, Any], *, progress: bool) -> tuple[Any, float]:
    """The completer, and the seconds that its import and its weights took."""
    started = perf_counter()
    from steered_marigold.methods.steered import SteeredCompleter

    completer = SteeredCompleter.from_checkpoint(**model, progress=progress)
    return completer, round(perf_counter() - started, 4)


def _print_json(record: dict[str, Any]) -> None:
    print(json.dumps(record, allow_nan=False), flush=True)


def _print_paths(record: dict[str, Any]) -> None:
    for name in ("output", "uncertainty", "visualization", "point_cloud"):
        if name in record:
            print(f"{name.replace('_', ' ')}: {record[name]}")
    if record["depth_min_m"] is not None:
        print(
            f"{record['depth_min_m']:.2f} to {record['depth_max_m']:.2f} m, "
            f"{record['input_valid_fraction']:.1%} measured, {record['seconds']:.1f} s"
        )
