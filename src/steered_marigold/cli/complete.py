"""steered-marigold complete: a frame's files, or folders of them, to dense metric depth."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from enum import StrEnum
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument

from steered_marigold.cli.engines import Count, EngineName, counted, make_engine
from steered_marigold.cli.messages import say, say_error, warn_of
from steered_marigold.cli.options import Dtype, option_panel, path_or_url
from steered_marigold.cli.progress import progress_bar
from steered_marigold.errors import InputError

if TYPE_CHECKING:
    from steered_marigold.batch.engines import Engine
    from steered_marigold.batch.job import JobSettings, Plan
    from steered_marigold.batch.manifest import Settings
    from steered_marigold.frames.outputs import Outputs
    from steered_marigold.frames.sources import FrameFiles, Reading
    from steered_marigold.methods.completer import DepthCompleter

Show = Callable[[dict[str, Any]], None]
Load = Callable[..., "DepthCompleter"]

_write = option_panel("What to write")
_read = option_panel("How to read the files")
_method = option_panel("How to complete")
_many = option_panel("Many frames")
_PRESETS = "the preset's"
_PATH: dict[str, Any] = {"parser": path_or_url, "metavar": "<path>"}


class DepthGrid(StrEnum):
    """How the depth map's pixels relate to the image's."""

    SAME = "same"
    REGISTERED = "registered"


def complete(
    image: Annotated[
        Path,
        Argument(
            parser=path_or_url,
            help="An image, or a folder of them; or shards of frames (.tar, .parquet; "
            "docs/scale.md). A file, or a URL as s3://bucket/images.",
        ),
    ],
    depth: Annotated[
        Path | None,
        Argument(
            parser=path_or_url,
            help="Its incomplete depth (.png of 16 bits, .tiff, .npy, .exr; 0 = missing), or a "
            "folder of depth maps with the stems of the images.",
        ),
    ] = None,
    *,
    output: Annotated[
        Path | None,
        _write(
            "-o",
            "--output",
            **_PATH,
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
    uncertainty: Annotated[
        Path | None, _write(**_PATH, help="The error's standard deviation [m].")
    ] = None,
    visualization: Annotated[
        Path | None, _write(**_PATH, help="A .png of image, input, result and uncertainty.")
    ] = None,
    point_cloud: Annotated[
        Path | None, _write(**_PATH, help="A coloured .ply in metres; needs --intrinsics.")
    ] = None,
    rerun: Annotated[
        Path | None, _write(help="A .rrd of images, depth and clouds, for Rerun.")
    ] = None,
    max_uncertainty: Annotated[
        float | None,
        _write(help="Write 0 (unknown) where the uncertainty [m] is larger."),
    ] = None,
    as_json: Annotated[
        bool, _write("--json", help="Print one JSON record a frame on stdout, all else on stderr.")
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
    depth_encoding: Annotated[
        str,
        _read(
            help="What DEPTH's numbers are: z, ray, disparity, inverse, sunrgbd, tum, kitti, "
            "carla, rgb24 or tartanair."
        ),
    ] = "z",
    baseline: Annotated[
        float | None, _read(help="Of disparity: distance of the two cameras [m].")
    ] = None,
    depth_grid: Annotated[
        DepthGrid, _read(help="registered: DEPTH has a lower resolution and an equal view.")
    ] = DepthGrid.SAME,
    intrinsics: Annotated[
        str | None,
        _read(help="K of the image: fx,fy,cx,cy in pixels, or a file (docs/your-data.md)."),
    ] = None,
    depth_intrinsics: Annotated[
        str | None, _read(help="K of DEPTH where another camera measured it; with --extrinsics.")
    ] = None,
    extrinsics: Annotated[
        str | None,
        _read(help="From that camera's frame to the image's: x,y,z [m], or a file of a 4x4."),
    ] = None,
    undistort: Annotated[
        bool, _read("--undistort", help="Take the distortion in --intrinsics out of both.")
    ] = False,
    confidence: Annotated[
        Path | None,
        _read(
            **_PATH,
            help="Weights of the measurements: .png (white = 1) or .npy in 0..1, or a folder.",
        ),
    ] = None,
    sensor_noise: Annotated[
        str | None,
        _read(
            help="How closely measurements are met: metres, or per cent of depth as 1%.",
            show_default=_PRESETS,
        ),
    ] = None,
    slop: Annotated[
        float, _read(help="Of folders whose names are time stamps: seconds within a pair.")
    ] = 0.02,
    associations: Annotated[
        Path | None, _read(help="Of folders: a file that lists the pairs, as TUM's.")
    ] = None,
    no_measurements: Annotated[
        bool,
        _read("--no-measurements", help="Where nothing was measured, give relative depth."),
    ] = False,
    checkpoint: Annotated[
        str, _method(help="embedded, a folder, or a hub id in Marigold's format.")
    ] = "embedded",
    preset: Annotated[
        str, _method(help="default, fast (CPUs, live use), paper or paper-minmax.")
    ] = "default",
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
    knobs: Annotated[
        list[str] | None,
        _method(
            "--set", help="Any other knob of docs/presets.md, as anchor_fraction=0.1; repeatable."
        ),
    ] = None,
    overwrite: Annotated[
        bool, _many("--overwrite", help="Redo the frames of a folder that have their results.")
    ] = False,
    workers: Annotated[int, _many(min=1, help="Processes, each with a model of its own.")] = 1,
    threads: Annotated[
        int | None,
        _many(
            min=1,
            help="Of each worker, on CPUs. The same number gives the same bytes on any engine.",
            show_default="the cores, divided",
        ),
    ] = None,
    engine: Annotated[
        EngineName, _many(help="ray: a cluster, see docs/scale.md.")
    ] = EngineName.LOCAL,
    ray_address: Annotated[
        str | None, _many(help="Of the cluster.", show_default="one of this machine")
    ] = None,
    actors: Annotated[
        int | None,
        _many(min=1, help="Models on the cluster.", show_default="its GPUs, or CPUs but one"),
    ] = None,
) -> None:
    """Complete the depth of a frame, or of two folders of frames.

    Depth is z along the optical axis, in metres. See docs/complete.md for cameras, conventions
    and the JSON record.
    """
    from steered_marigold.batch.job import JobSettings, plan
    from steered_marigold.batch.manifest import describe_model, describe_settings, threads_before
    from steered_marigold.diffusion.settings import KNOBS
    from steered_marigold.frames.outputs import Outputs
    from steered_marigold.frames.shards import holds_shards, shard_source
    from steered_marigold.frames.sources import FrameFiles, Reading, folder_source
    from steered_marigold.io.extrinsics import read_extrinsics
    from steered_marigold.io.files import require_writable
    from steered_marigold.io.intrinsics import read_intrinsics
    from steered_marigold.methods.settings_text import read_settings

    sharded = depth is None and holds_shards(image)
    if depth is None and not no_measurements and not sharded:
        raise InputError(
            "`depth` is missing; for relative depth from the image alone give `no_measurements`"
        )
    if depth is None and confidence is not None:
        raise InputError("`confidence` weighs measurements: give `depth` too")
    many = sharded or image.is_dir()
    inputs = FrameFiles(image=image, depth=depth, confidence=confidence)
    outputs = Outputs(
        depth=output or Path("completed" if many else f"{image.stem}_completed.png"),
        uncertainty=uncertainty,
        visualization=visualization,
        point_cloud=point_cloud,
    )
    reading = Reading(
        depth_scale=depth_scale,
        max_depth=max_depth,
        depth_encoding=depth_encoding,
        baseline=baseline,
        registered=depth_grid is DepthGrid.REGISTERED,
        intrinsics=None if intrinsics is None else read_intrinsics(intrinsics),
        depth_intrinsics=None if depth_intrinsics is None else read_intrinsics(depth_intrinsics),
        extrinsics=None if extrinsics is None else read_extrinsics(extrinsics),
        undistort=undistort,
        no_measurements=no_measurements,
        slop=slop,
        associations=associations,
    )
    settings = JobSettings(
        seed=seed,
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
        **read_settings("--set", knobs or [], KNOBS),
    }
    suffix = f".{output_format}"
    of_frame = outputs.of_frame if many else outputs.in_folders
    of_frame(image.stem, suffix).require_possible(
        has_K=reading.intrinsics is not None, output_scale=output_scale
    )
    show = _print_json if as_json else _print_paths
    if rerun is not None and (workers != 1 or engine is EngineName.RAY):
        raise InputError(
            "`rerun` is written by one process: leave `workers` and `engine` as they are, or make "
            "it from the results with the command `view`"
        )
    if many:
        source = shard_source(image, reading) if sharded else folder_source(inputs, reading)
        todo = plan(source, outputs, suffix=suffix, overwrite=overwrite)
        where = make_engine(
            engine,
            workers=workers,
            threads=threads or (None if overwrite else threads_before(outputs.depth)),
            ray_address=ray_address,
            actors=actors,
        )
        how = describe_model(model) | {"threads": where.threads}
        described = describe_settings(inputs, reading, settings, how, suffix)
        with _loading(model, rerun) as load:
            failed = _complete_folders(
                todo, settings, load, described, where, show, overwrite=overwrite
            )
        if rerun is not None:
            left_out = f", without {todo.skipped} that had their results" if todo.skipped else ""
            say(f"{rerun}: the frames of this run{left_out}")
        if failed:
            raise typer.Exit(1)
    else:
        outputs = outputs.in_folders(image.stem, suffix)
        outputs.require_distinct(inputs)
        for path in outputs.asked().values():
            require_writable(path)
        with _loading(model, rerun) as load:
            _complete_one(inputs, reading, outputs, settings, load, show)


def _complete_one(
    inputs: "FrameFiles",
    reading: "Reading",
    outputs: "Outputs",
    settings: "JobSettings",
    load: Load,
    show: "Show",
) -> None:
    """One frame; bad input is told before the model is loaded."""
    from steered_marigold.batch.job import complete_to_files
    from steered_marigold.frames.sources import read_frame

    frame = read_frame(inputs, reading)
    started = perf_counter()
    completer = load(progress=sys.stderr.isatty())
    load_seconds = round(perf_counter() - started, 4)
    record = complete_to_files(completer, frame, inputs, outputs, settings)
    warn_of(inputs.image, record)
    show(record.to_json() | {"load_seconds": load_seconds})


def _complete_folders(
    todo: "Plan",
    settings: "JobSettings",
    load: Load,
    described: "Settings",
    engine: "Engine",
    show: "Show",
    *,
    overwrite: bool,
) -> int:
    """Many frames; how many failed."""
    from steered_marigold.batch.run import complete_all

    if todo.source.rule:
        say(f"{todo.total} frames, paired by {todo.source.rule}")
    for path in todo.source.lone:
        say_error(f"{path}: belongs to no pair")
    count, total = Count(skipped=todo.skipped, failed=len(todo.source.lone)), len(todo.frames)
    outcomes = complete_all(load, todo, settings, described, engine=engine, overwrite=overwrite)
    with counted(count), closing(outcomes), progress_bar("completing", total) as bar:
        for done, outcome in enumerate(outcomes, start=1):
            if outcome.record is None:
                say_error(f"{outcome.frame}: {outcome.error}")
                count.failed += 1
            else:
                count.completed += 1
                warn_of(outcome.frame, outcome.record)
                show(outcome.record.to_json())
            bar(done, total, f"completing, {count.failed} failed" if count.failed else "completing")
            if outcome.ends_run:
                say_error(f"the run ends here, {total - done} frames are left")
    return count.failed


def _parse_sensor_noise(text: str) -> Any:
    """A SensorNoise from metres, "0.01", or per cent of depth, "1%"."""
    try:
        amount = float(text.removesuffix("%"))
    except ValueError:
        amount = -1.0
    if not 0 <= amount < float("inf"):
        raise InputError(f"`sensor_noise` {text}: give metres, as 0.01, or per cent, as 1%")
    from steered_marigold.core.consistency import SensorNoise

    return SensorNoise(fraction=amount / 100) if text.endswith("%") else SensorNoise(metres=amount)


@contextmanager
def _loading(model: dict[str, Any], rerun: Path | None) -> Iterator[Load]:
    """What loads the completer; its answers go to `rerun`, too."""
    if rerun is None:
        yield partial(_load, model)
        return
    from steered_marigold.frames.viewing import ViewedCompleter, rerun_log

    with rerun_log(rerun) as viewing:
        yield lambda **how: ViewedCompleter(_load(model, **how), viewing)


def _load(model: dict[str, Any], *, progress: bool = False) -> "DepthCompleter":
    """The completer; imports it only now."""
    from steered_marigold.methods.steered import SteeredCompleter

    return SteeredCompleter.from_checkpoint(**model, progress=progress)


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
