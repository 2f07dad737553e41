"""Stated against true error over protocols: a figure and a table from finished runs.

python -m benchmarks.uncertainty RUN... --output docs/images/uncertainty.png

Each RUN is a folder of `steered-marigold evaluate`, one a protocol. Figures are those of one
method in the area that the protocol is about.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from steered_marigold.evaluation.calibration_figure import calibration_figure, kept_curves
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.io.files import write_figure

COLUMNS = {
    "abs_rel": "REL",
    "rmse_m": "RMSE [m]",
    "coverage90": "coverage of 90 %",
    "spearman": "Spearman",
    "floored_fraction": "floored",
    "wrong_left_out": "wrong left out",
    "right_left_out": "right left out",
}


def main(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    output: Annotated[Path | None, typer.Option(help="Picture to write.")] = None,
    method: Annotated[str | None, typer.Option(help="Default: the runs' first.")] = None,
) -> None:
    """Print the table; write the figure if asked."""
    curves = {}
    typer.echo(_pipes("protocol", *COLUMNS.values()))
    typer.echo(_pipes(*["---"] * (1 + len(COLUMNS))))
    for run in runs:
        settings = RunSettings.load(run)
        label = method or settings.methods[0]
        name = settings.protocol.name
        curve = kept_curves(run, settings).get(label)
        if curve is not None:
            curves[name] = curve
        row = _row(run, label, settings.protocol.focus)
        typer.echo(_pipes(name, *(_number(row.get(key)) for key in COLUMNS)))
    figure = calibration_figure(curves, "that each protocol is about")
    if output is not None and figure is not None:
        write_figure(output, figure)


def _row(run: Path, method: str, area: str) -> dict[str, Any]:
    """The summary's row of a method and area."""
    rows = json.loads((run / "summary.json").read_text(encoding="utf-8"))["rows"]
    return next(dict(row) for row in rows if row["method"] == method and row["area"] == area)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _pipes(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    typer.run(main)
