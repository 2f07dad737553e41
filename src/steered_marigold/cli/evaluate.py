"""steered-marigold evaluate: methods on a data set under a protocol, as tables and a report."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from steered_marigold.cli.engines import Count, EngineName, counted, make_engine
from steered_marigold.cli.messages import say_error, say_warning
from steered_marigold.cli.options import Dtype, option_panel
from steered_marigold.cli.progress import progress_bar
from steered_marigold.errors import InputError

if TYPE_CHECKING:
    from steered_marigold.evaluation.runner import Run
    from steered_marigold.evaluation.settings import RunSettings

_data = option_panel("Which frames")
_protocol = option_panel("What is measured")
_run = option_panel("How to run")


def evaluate(
    dataset: Annotated[str, Argument(help="nyuv2, nyuv2-h5, kitti, folder or recording.")],
    path: Annotated[
        Path, Argument(help="nyu_depth_v2_labeled.mat, the data set's folder, or a recording.")
    ],
    *,
    output: Annotated[
        Path, Option("-o", "--output", help="Folder of the run; a stopped run goes on there.")
    ],
    methods: Annotated[
        str,
        Option(help="Names with commas; settings after @: paper@steering_strength=0.2."),
    ] = "linear,nearest,ip-basic,telea,marigold,default",
    split: Annotated[str, _data(help="Of nyuv2: test, train or all.")] = "test",
    ground_truth: Annotated[
        str, _data(help="Of nyuv2: raw (the sensor's) or inpainted (dense).")
    ] = "raw",
    depth_scale: Annotated[
        float | None, _data(help="Of a folder: metres per unit; default as in `complete`.")
    ] = None,
    max_depth: Annotated[
        float | None, _data(help="Of a folder: farther depth [m] counts as missing.")
    ] = None,
    frames: Annotated[Path | None, _data(help="File with one frame id a line.")] = None,
    limit: Annotated[int | None, _data(min=1, help="So many frames, evenly spaced.")] = None,
    protocol: Annotated[
        str,
        _protocol(
            help="paper-uniform, paper-erased, range, half, lidar, objects, shape, region, sensor, "
            "dense, or given (the data set's own sparse depth)."
        ),
    ] = "paper-erased",
    points: Annotated[
        int | None, _protocol(help="Of paper-*: samples.", show_default="5 % of all pixels")
    ] = None,
    max_range: Annotated[
        float | None, _protocol(help="Of range: how far the sensor reaches [m].", show_default="3")
    ] = None,
    keep: Annotated[
        str | None, _protocol(help="Of half: near, far, bottom or left.", show_default="near")
    ] = None,
    lines: Annotated[int | None, _protocol(help="Of lidar: scan lines.", show_default="64")] = None,
    masks: Annotated[
        Path | None, _protocol(help="Of sensor: a folder of real depth maps, for their holes.")
    ] = None,
    noise: Annotated[
        float, _protocol(help="Standard deviation of noise, as a fraction of the depth.")
    ] = 0.0,
    outliers: Annotated[float, _protocol(help="Fraction of the measurements that is wrong.")] = 0.0,
    flying_pixels: Annotated[
        float, _protocol(help="Fraction of those at depth edges that mix both sides.")
    ] = 0.0,
    patches: Annotated[
        int, _protocol(help="Connected regions of 50 to 2000 px with false depth.")
    ] = 0,
    official_metrics: Annotated[
        bool,
        _protocol("--official-metrics", help="Count negative depth as right, as the authors do."),
    ] = False,
    seed: Annotated[int, _run(min=0, help="Of the samples and of the methods.")] = 0,
    workers: Annotated[int, _run(min=1, help="Processes, each with a model of its own.")] = 1,
    threads: Annotated[
        int | None,
        _run(min=1, help="Of each worker, on CPUs.", show_default="the cores, divided"),
    ] = None,
    engine: Annotated[
        EngineName, _run(help="ray: a cluster, see docs/scale.md.")
    ] = EngineName.LOCAL,
    ray_address: Annotated[
        str | None, _run(help="Of the cluster.", show_default="one of this machine")
    ] = None,
    actors: Annotated[
        int | None, _run(min=1, help="On the cluster.", show_default="its GPUs, or CPUs but one")
    ] = None,
    checkpoint: Annotated[
        str, _run(help="embedded, a folder, or a hub id in Marigold's format.")
    ] = "embedded",
    device: Annotated[str, _run(help="cpu, cuda, mps.")] = "cpu",
    dtype: Annotated[
        Dtype, _run(help="What all networks compute in; auto: what the device is fastest in.")
    ] = Dtype.FLOAT32,
    weights: Annotated[
        str, _run(help="METHOD=FILE with commas, for bpnet and completionformer.")
    ] = "",
    overwrite: Annotated[
        bool, _run("--overwrite", help="Begin anew if the folder holds a run.")
    ] = False,
    predictions: Annotated[
        bool, _run("--predictions/--no-predictions", help="Keep the depth of every answer.")
    ] = True,
    rerun: Annotated[
        Path | None, _run(help="A .rrd of all kept answers beside the truth, for Rerun.")
    ] = None,
) -> None:
    """Compare methods on a data set, and write tables and a report.

    See docs/evaluation.md for protocols, areas and files.
    """
    from steered_marigold.datasets.dataset import select_frames
    from steered_marigold.datasets.registry import open_dataset
    from steered_marigold.evaluation.protocols import Protocol
    from steered_marigold.evaluation.report import write_outputs
    from steered_marigold.evaluation.settings import RunSettings
    from steered_marigold.evaluation.viewing import view_run
    from steered_marigold.frames.viewing import require_rerun

    if rerun is not None:
        if not predictions:
            raise InputError("`rerun` shows answers that were kept: leave `predictions` on")
        require_rerun(rerun)
    reading: dict[str, Any] = {
        "split": split,
        "ground_truth": ground_truth,
        "depth_scale": depth_scale,
        "max_depth": max_depth,
    }
    settings = RunSettings(
        dataset=dataset,
        path=path.resolve(),
        **reading,
        protocol=Protocol(
            kind=protocol,
            points=points,
            max_range=max_range,
            keep=keep,
            lines=lines,
            masks=masks and masks.resolve(),
            noise=noise,
            outliers=outliers,
            flying_pixels=flying_pixels,
            patches=patches,
        ),
        methods=_method_labels(methods),
        frames=select_frames(
            open_dataset(dataset, path, **reading), frames_file=frames, limit=limit
        ),
        seed=seed,
        official_metrics=official_metrics,
        checkpoint=checkpoint,
        device=device,
        dtype=dtype.value,
        weights=dict(_method_and_file(item) for item in filter(None, weights.split(","))),
    )
    where = make_engine(
        engine, workers=workers, threads=threads, ray_address=ray_address, actors=actors
    )
    run = _run_with_progress(
        settings, output, engine=where, overwrite=overwrite, keep_predictions=predictions
    )
    write_outputs(run, output)
    print((output / "table.md").read_text(encoding="utf-8"))
    print(f"report: {output / 'report.html'}")
    if rerun is not None:
        print(f"rerun: {rerun}, {view_run(run, output, rerun)} frames")
    if run.failures:
        say_error(f"{len(run.failures)} images failed; see {output / 'table.md'}")
        raise typer.Exit(1)


def _method_labels(text: str) -> tuple[str, ...]:
    """Names at commas, but `a@x=1,y=2` is one name. InputError for none or a repeated one."""
    from steered_marigold.methods.registry import method_label

    names: list[str] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        if "=" in part and "@" not in part and names:
            names[-1] += f",{part}"
        else:
            names.append(part)
    labels = [method_label(name) for name in names]
    if not labels or len(set(labels)) < len(labels):
        raise InputError(f"`methods` {text!r} names no method, or one of them twice")
    for name, label in zip(names, labels, strict=True):
        if name != label:
            say_warning(f"{name} is called {label} now; the old name goes with version 0.3")
    return tuple(labels)


def _method_and_file(text: str) -> tuple[str, Path]:
    method, separator, file = text.partition("=")
    if not separator:
        raise InputError(f"`weights` {text!r} must be METHOD=FILE")
    return method, Path(file).resolve()


def _run_with_progress(settings: "RunSettings", folder: Path, **how: Any) -> "Run":
    """Runs; failures are told as they happen.

    how: engine, overwrite and keep_predictions of `run_evaluation`.
    """
    from steered_marigold.evaluation.results import ImageResult
    from steered_marigold.evaluation.runner import run_evaluation

    count = Count()
    with counted(count), progress_bar("evaluating") as bar:

        def on_result(result: ImageResult, done: int, total: int) -> None:
            bar(done, total, result.method)
            if result.error:
                count.failed += 1
                say_error(f"{result.method}, frame {result.frame_id}: {result.error}")
            else:
                count.completed += 1

        return run_evaluation(settings, folder, on_result=on_result, warn=say_warning, **how)
