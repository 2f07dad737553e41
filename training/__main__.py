"""The recipe of the embedded checkpoint: `python -m training STAGE`, see docs/training.md.

Rendered data comes from `python -m rooms --output ROOMS --frames 9000`.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from training import codec, denoiser, image_branch
from training.crops import write_crops
from training.export import export
from training.held_out import held_out
from training.mixture import Sources
from training.start import CHECKPOINT

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
Runs = Annotated[Path, typer.Option(help="Folder of logs and weights; a stage resumes from it.")]
Rooms = Annotated[
    list[Path] | None, typer.Option(help="Folder of procedural shards; may be given several times.")
]
Nyuv2 = Annotated[Path | None, typer.Option(help="NYUv2 folder.")]
Rgbd = Annotated[Path | None, typer.Option(help="Folder of RGB-D pairs of other sources.")]
ProceduralOnly = Annotated[
    bool, typer.Option("--procedural-only", help="Train on rooms alone; measure on the tune split.")
]
Minutes = Annotated[float, typer.Option(help="How long to train, in processor minutes.")]
From = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="CHECKPOINT|scratch",
        help="A checkpoint folder for what has no weights in RUNS yet, or scratch for ImageNet's "
        "alone. Default: the embedded checkpoint; scratch with --procedural-only or without "
        "photographs, to keep their terms away.",
    ),
]


def _start(checkpoint: str | None, sources: Sources) -> Path | None:
    """The folder that --from means; None is scratch."""
    if checkpoint is None:
        return None if sources.procedural_only else CHECKPOINT
    return None if checkpoint == "scratch" else Path(checkpoint)


def _add_stage(
    name: str, train: Callable[..., None], folder: str, default_minutes: float, summary: str
) -> None:
    """A command that trains one stage in a folder of RUNS; all stages take the same options."""

    @app.command(name, help=summary)
    def stage(
        runs: Runs,
        rooms: Rooms = None,
        nyuv2: Nyuv2 = None,
        rgbd: Rgbd = None,
        procedural_only: ProceduralOnly = False,
        minutes: Minutes = default_minutes,
        checkpoint: From = None,
    ) -> None:
        rendered = Sources(rooms=rooms or ())
        sources = rendered if procedural_only else replace(rendered, nyuv2=nyuv2, rgbd=rgbd)
        tune, start = held_out("tune", nyuv2, rgbd), _start(checkpoint, sources)
        train(sources, runs / folder, minutes=minutes, tune=tune, start=start)


_add_stage(
    "image-branch", image_branch.train, "image_branch", 60,
    "Stage 1: the image encoder as a regressor.",
)  # fmt: skip
_add_stage(
    "codec", codec.train, "codec", 40,
    "Stage 2: depth to latents and back; independent of stage 1.",
)  # fmt: skip
_add_stage(
    "denoiser", denoiser.train, "", 60,
    "Stage 3: the U-Net on the frozen results of stages 1 and 2.",
)  # fmt: skip


@app.command("export")
def _export(
    runs: Runs,
    to: Path = CHECKPOINT,
    checkpoint: Annotated[
        Path | None,
        typer.Option("--from", help="The denoiser stage's, if stage 1 or 2 has no run in RUNS."),
    ] = None,
    share: Annotated[
        float, typer.Option(help="Of the trained weights, beside those of --from.", min=0, max=1)
    ] = 1.0,
) -> None:
    """Stage 4: the checkpoint that the package ships."""
    export(runs, to, checkpoint, share=share)


@app.command("crops")
def _crops(
    nyuv2: Annotated[Path, typer.Option(help="NYUv2 folder.")],
    output: Annotated[Path, typer.Option(help="An .npz file, for `python -m rooms --crops`.")],
    rgbd: Rgbd = None,
) -> None:
    """Textures for rendered surfaces: crops of the training photographs."""
    write_crops(output, nyuv2, rgbd)


@app.command("evaluate")
def _evaluate(
    nyuv2: Annotated[Path, typer.Option(help="NYUv2 folder.")],
    output: Annotated[Path, typer.Option(help="Folder of figures.json, figures.md, pictures.")],
    checkpoint: Annotated[str, typer.Option(help="embedded, or a folder.")] = "embedded",
    split: Annotated[Literal["report", "tune"], typer.Option(help="Held-out frames.")] = "report",
    limit: Annotated[int | None, typer.Option(help="Frames, evenly spaced.", min=1)] = None,
    real_frames: Annotated[Path | None, typer.Option(help="Folders of rgb and depth.")] = None,
    rgbd: Rgbd = None,
    parts: Annotated[
        str | None, typer.Option(help="One or several; all, but kinds only with --rgbd.")
    ] = None,
    steps: Annotated[str, typer.Option(help="Ascending; the last is steering's.")] = "1,4,10,50",
    samples: Annotated[int, typer.Option(help="Samples of a frame.", min=2)] = 8,
) -> None:
    """Stage 5: what a checkpoint is worth; parts are added to what `output` holds."""
    from training.evaluation.run import PARTS, evaluate
    from training.evaluation.subject import Subject, split_frames

    subject = Subject(
        checkpoint=checkpoint,
        nyuv2=nyuv2,
        frames=split_frames(split, limit),
        steps=tuple(int(n) for n in steps.split(",")),
        samples=samples,
        output=output,
        real_frames=real_frames,
        rgbd=rgbd,
        split=split,
        limit=limit,
    )
    known = [name for name in PARTS if rgbd or name != "kinds"]
    evaluate(subject, parts.split(",") if parts else known)


if __name__ == "__main__":
    warnings.filterwarnings("ignore", category=FutureWarning)
    app()
