"""Time and memory of stages and of whole images, each against the authors' procedure.

    python -m benchmarks.performance embedded full

Figures of one table come from one process, and the variants of a row from interleaved repeats.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import torch
import typer

from benchmarks import reference
from benchmarks.measuring import (
    Force,
    describe,
    idle_machine,
    markdown_table,
    measure_interleaved,
    ratio_cell,
    write_json,
)
from benchmarks.runs import OURS, REFERENCE, RUNS, run_pipeline, run_reference
from benchmarks.schedule import Schedule, extrapolate, observe
from benchmarks.stages import BFLOAT16, Networks, Timings, time_stages
from benchmarks.subjects import (
    FULL_SIZE_PROMPT_CHANNELS,
    PAPER_FRACTION,
    BenchmarkFrame,
    embedded_pipeline,
    full_size_unet,
    full_size_vae,
    sample_frame,
    stand_in_pipeline,
)
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline

FLOAT32 = "float32"


class Scale(StrEnum):
    """The embedded checkpoint, or random models of Stable Diffusion 2's shapes."""

    EMBEDDED = "embedded"
    FULL = "full"


def main(
    scales: Annotated[list[Scale] | None, typer.Argument(show_default="both")] = None,
    *,
    output: Annotated[Path, typer.Option(help="Folder of the JSON files.")] = Path("runs/bench"),
    embedded_size: Annotated[str, typer.Option(help="Width x height in pixels.")] = "320x240",
    full_size: Annotated[str, typer.Option(help="Width x height in pixels.")] = "608x448",
    full_steps: Annotated[
        int, typer.Option(help="Steps of a full checkpoint where a preset leaves them to it.")
    ] = 4,
    repeats: Annotated[int, typer.Option(min=1, help="Timed runs of each variant.")] = 5,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    force: Force = False,
) -> None:
    """Stages and whole images at embedded and at full size, against the authors' procedure."""
    machine = idle_machine(threads, force=force)
    print(f"{describe(machine)}\n")
    torch.set_num_threads(threads)
    for scale in scales or list(Scale):
        if scale is Scale.EMBEDDED:
            content = measure_embedded(embedded_size, repeats)
        else:
            content = measure_full_size(full_size, full_steps, repeats)
        settings = {"scale": scale, "warm_up": 1, "repeats": repeats, "seed": 0}
        record = {"machine": machine, "settings": settings, **content}
        write_json(output / f"performance-{scale}.json", record)


def measure_embedded(size: str, repeats: int) -> dict[str, Any]:
    """Stages and whole images of the embedded checkpoint, all measured; prints both tables."""
    width, height = map(int, size.split("x"))
    frame = sample_frame(width, height, round(PAPER_FRACTION * width * height))
    pipeline = embedded_pipeline()
    prompt = reference.empty_prompt(pipeline.tokenizer, pipeline.text_encoder)
    networks = Networks(pipeline.unet, pipeline.vae, pipeline.image_encoder, prompt)
    print(f"## Embedded checkpoint, {size}, {int(frame.mask.sum())} measurements\n")
    stages = time_stages(networks, frame, warm_up=3, repeats=max(repeats, 5))
    print(stage_table(stages))
    schedules = observe_runs(pipeline, frame)
    half = _channels_last(embedded_pipeline(torch.bfloat16))
    works: dict[tuple[str, str], Callable[[], int]] = {}
    for name, precision in _variants():
        models = pipeline if precision == FLOAT32 else half
        works[name, precision] = partial(_run, models, frame, name)
    images = measure_interleaved(works, warm_up=1, repeats=repeats)
    rows = extrapolated_rows(schedules, stages)
    for row in rows:
        row["measured"] = images[row["run"], row["precision"]]
    print(
        "\nWhole images, measured; beside it what the stages above would extrapolate to, as a "
        f"check of that method.\n\n{image_table(rows)}"
    )
    return {"size": size, "stages": stages, "images": rows}


def measure_full_size(size: str, steps: int, repeats: int) -> dict[str, Any]:
    """Stages at full size, measured, and whole images, extrapolated; prints both tables."""
    width, height = map(int, size.split("x"))
    frame = sample_frame(width, height, round(PAPER_FRACTION * width * height))
    schedules = observe_runs(stand_in_pipeline(steps), frame)
    prompt = torch.randn(1, reference.PROMPT_TOKENS, FULL_SIZE_PROMPT_CHANNELS)
    networks = Networks(full_size_unet(), full_size_vae(), None, prompt)
    print(f"## Full size, {size}, random weights, {int(frame.mask.sum())} measurements\n")
    stages = time_stages(networks, frame, warm_up=1, repeats=repeats)
    print(stage_table(stages))
    print(
        "\nWhole images are extrapolated, not run: the samples that a real run of each preset "
        "sends through each network (counted with the embedded models on this grid and "
        f"{steps} steps where the preset leaves them to the checkpoint), times the medians above, "
        "plus that run's time outside the networks.\n"
    )
    rows = extrapolated_rows(schedules, stages)
    print(extrapolation_table(rows))
    return {"size": size, "checkpoint_steps": steps, "stages": stages, "extrapolated_images": rows}


def stage_table(stages: Timings) -> str:
    """Each stage and variant, with how many times faster than the reference it is."""
    header = ("stage", "variant", "median s", "spread s", "memory MiB", "times faster")
    rows = [
        (stage, variant, *timing.cells, ratio_cell(timing, timings.get(REFERENCE)))
        for stage, timings in stages.items()
        for variant, timing in timings.items()
    ]
    return markdown_table(header, rows)


def observe_runs(pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame) -> dict[str, Schedule]:
    """The schedules of the reference and of every run, after one short run as a warm-up."""
    run_pipeline(pipeline, frame, "fast")
    return {
        name: observe(pipeline, partial(_run, pipeline, frame, name)) for name in (REFERENCE, *RUNS)
    }


def _run(pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame, name: str) -> int:
    return (
        run_reference(pipeline, frame) if name == REFERENCE else run_pipeline(pipeline, frame, name)
    )


def image_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Each run of a whole image that was measured."""
    header = (
        "whole image", "precision", "median s", "spread s", "memory MiB", "times faster",
        "extrapolated s",
    )  # fmt: skip
    return markdown_table(
        header,
        [
            (
                *(row["run"], row["precision"], *row["measured"].cells),
                ratio_cell(row["measured"], rows[0]["measured"]),
                f"{row['seconds']:.3g}",
            )
            for row in rows
        ],
    )


def extrapolated_rows(schedules: dict[str, Schedule], stages: Timings) -> list[dict[str, Any]]:
    """Each run with its schedule and its time in each precision."""
    rows: list[dict[str, Any]] = []
    for name, precision in _variants():
        variant = REFERENCE if precision == FLOAT32 else BFLOAT16
        medians = {s: stages[s][variant].median for s in ("image", "unet", "decode", "encode")}
        result = extrapolate(schedules[name], medians)
        first = rows[0]["seconds"] if rows else result.seconds
        rows.append(
            {
                "run": name,
                "precision": precision,
                **asdict(schedules[name]),
                **asdict(result),
                "times_faster": first / result.seconds,
            }
        )
    return rows


def extrapolation_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The schedule and the extrapolated time of each run."""
    header = (
        "whole image", "precision", "U-Net steps", "exact decodes", "exact encodes",
        "approximate decodes", "approximate encodes", "extrapolated s", "times faster",
        "steering / U-Net",
    )  # fmt: skip
    keys = (
        *("run", "precision", "unet", "decode", "encode"),
        *("approximate_decode", "approximate_encode"),
    )
    return markdown_table(
        header,
        [
            (
                *(row[key] for key in keys),
                f"{row['seconds']:.3g}",
                f"{row['times_faster']:.3g}",
                f"{row['steering_share']:.1%}",
            )
            for row in rows
        ],
    )


def _variants() -> Iterable[tuple[str, str]]:
    """(run, precision): the reference first."""
    in_float32 = ((name, FLOAT32) for name in (REFERENCE, *RUNS))
    return itertools.chain(in_float32, ((name, BFLOAT16) for name in OURS))


def _channels_last(pipeline: SteeredMarigoldPipeline) -> SteeredMarigoldPipeline:
    for model in (pipeline.unet, pipeline.vae, pipeline.image_encoder):
        model.to(memory_format=torch.channels_last)
    return pipeline


if __name__ == "__main__":
    typer.run(main)
