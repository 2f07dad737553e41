"""figures.json, to which every part adds its own, and figures.md, the same to read."""

import json
from pathlib import Path
from typing import Any

from steered_marigold.errors import InputError
from steered_marigold.io.files import atomic_write
from training.evaluation.subject import Findings, Row

JSON, MARKDOWN = "figures.json", "figures.md"


def add_part(folder: Path, subject: Row, name: str, conditions: Row, found: Findings) -> None:
    """Adds a part to the figures in a folder, in place of an earlier one of that name.

    subject: what was evaluated, with its "weights". conditions: of this part.
    Raises InputError if the folder holds figures of other weights.
    """
    figures = read_figures(folder)
    check_same_weights(figures, subject, folder)
    part = {**conditions, "tables": found.tables, "pictures": list(found.pictures)}
    figures = {**subject, "parts": {**figures.get("parts", {}), name: part}}
    for path, text in (
        (folder / JSON, json.dumps(figures, indent=1) + "\n"),
        (folder / MARKDOWN, markdown(figures)),
    ):
        with atomic_write(path) as temporary:
            temporary.write_text(text, encoding="utf-8")


def read_figures(folder: Path) -> dict[str, Any]:
    """The figures in a folder; empty if there are none."""
    path = folder / JSON
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def check_same_weights(figures: dict[str, Any], subject: Row, folder: Path) -> None:
    """Raises InputError if the figures are of other weights than the subject's."""
    if figures.get("weights", subject["weights"]) != subject["weights"]:
        raise InputError(f"{folder}: holds figures of other weights; choose another --output")


def markdown(figures: dict[str, Any]) -> str:
    """The figures as headings, tables and pictures."""
    lines = [f"# Checkpoint {figures['checkpoint']}", "", f"Weights {figures['weights']}.", ""]
    for name, part in figures["parts"].items():
        details = {k: v for k, v in part.items() if k not in ("tables", "pictures")}
        lines += [f"## {name}", "", ", ".join(f"{k} {v}" for k, v in details.items()), ""]
        for title, rows in part["tables"].items():
            lines += [title, "", *_table(rows), ""]
        for picture in part["pictures"]:
            lines += [f"![{picture}]({picture})", ""]
    return "\n".join(lines)


def _table(rows: list[Row]) -> list[str]:
    head = list(rows[0])
    cells = [head, ["---"] * len(head), *([_cell(row[key]) for key in head] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in cells]


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
