"""steered-marigold figures: figures from a run of evaluate."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def figures(
    run: Annotated[Path, Argument(help="Folder that evaluate wrote.")],
    *,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Folder for them.", show_default="RUN/figures")
    ] = None,
    frame: Annotated[
        str | None, Option(help="Frame id.", show_default="the middle one of the run")
    ] = None,
) -> None:
    """Draw the paper's figures from a run, and those of seams and of uncertainty."""
    from steered_marigold.evaluation.figures import draw_figures

    for path in draw_figures(run, output or run / "figures", frame_id=frame):
        print(path)
