"""The figures of a run as tables: Markdown, LaTeX (booktabs) and, for the report, HTML."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import product
from typing import Any

from steered_marigold.evaluation.published import published_rows
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.evaluation.summary import (
    METRICS,
    TRUST_METRICS,
    UNCERTAINTY_METRICS,
    Comparison,
    verdict,
)

_KITTI_COLUMNS = ("abs_rel", "delta1", "rmse_mm", "mae_mm", "irmse_per_km", "imae_per_km")
_TITLES = {
    "abs_rel": "REL ↓",
    "delta1": "δ1 ↑",
    "rmse_m": "RMSE [m] ↓",
    "mae_m": "MAE [m] ↓",
    "rmse_mm": "RMSE [mm] ↓",
    "mae_mm": "MAE [mm] ↓",
    "irmse_per_km": "iRMSE [1/km] ↓",
    "imae_per_km": "iMAE [1/km] ↓",
    "spearman": "Spearman ↑",
    "ause": "AUSE ↓",
    "coverage90": "coverage of 90 %",
    "wrong_left_out": "wrong left out ↑",
    "right_left_out": "right left out ↓",
    "floored_fraction": "floored ↓",
    "seam_step": "seam",
}
_SETPOINTS = ("coverage90", "seam_step")  # best at a value, neither high nor low
_LATEX = {
    "%": r"\%",
    "_": r"\_",
    "δ1": r"$\delta_1$",
    "↓": r"$\downarrow$",
    "↑": r"$\uparrow$",
    "–": "--",
}


@dataclass(frozen=True)
class Cell:
    """A figure as text, its 95 % interval if there is one, and whether no row of ours is better."""

    text: str
    interval: str = ""
    best: bool = False


@dataclass(frozen=True)
class Table:
    """The rows of one area: first those of the run, then published ones; then sentences."""

    area: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    published: tuple[tuple[Cell, ...], ...] = ()
    notes: tuple[str, ...] = ()


def area_table(settings: RunSettings, rows: Sequence[Mapping[str, Any]], area: str) -> Table:
    """One area of a summary's rows: the paper's columns, then uncertainty, seam, trust, time."""
    rows = [row for row in rows if row["area"] == area]
    keys = [*(_KITTI_COLUMNS if settings.dataset == "kitti" else METRICS)]
    keys += [key for key in (*UNCERTAINTY_METRICS, "seam_step") if any(key in row for row in rows)]
    keys += [key for key in TRUST_METRICS if any(row.get(key) for row in rows)]
    # a mean without the images that failed is no contest
    whole = [row for row in rows if not row["failed"]]
    best = {
        key: _best(key, [row[key] for row in whole if row.get(key) is not None]) for key in keys
    }
    ours = [
        (
            Cell(row["method"]),
            Cell(row["runs_as"]),
            *(_cell(row, key, best[key]) for key in keys),
            Cell(f"{row['images']}" + (f" ({row['failed']} failed)" if row["failed"] else "")),
            Cell(_number(row["seconds_per_image"], 2)),
        )
        for row in rows
    ]
    published = [
        (
            Cell(f"{row.title} (published)"),
            Cell(""),
            *(Cell(_number(getattr(row, key, None))) for key in keys),
            Cell("654"),
            Cell("–"),
        )
        for row in published_rows(settings, area)
    ]
    header = ("method", "runs as", *(_TITLES[key] for key in keys), "images", "s / image")
    return Table(area, header, tuple(ours), tuple(published))


def comparison_table(compared: Comparison, area: str, reference: str) -> Table:
    """Differences of methods to the reference, the significant ones marked, and the verdicts."""
    methods = dict.fromkeys(method for method, _ in compared)
    cells = {
        task: Cell(
            f"{paired.difference:+.4f}",
            f"{paired.low:+.4f}, {paired.high:+.4f}",
            paired.significant,
        )
        for task, paired in compared.items()
    }
    rows = tuple(
        (Cell(method), *(cells.get((method, key), Cell("–")) for key in METRICS))
        for method in methods
    )
    notes = tuple(_verdict(compared, method, reference) for method in methods)
    return Table(area, ("method", *(_TITLES[key] for key in METRICS)), rows, notes=notes)


def _verdict(compared: Comparison, method: str, reference: str) -> str:
    """E.g. "default against linear: better in REL, RMSE; not distinguishable in δ1."."""
    found: dict[str, list[str]] = {"better": [], "worse": [], "not distinguishable": []}
    for (name, key), paired in compared.items():
        if name == method:
            found[verdict(key, paired)].append(_TITLES[key].split()[0])
    parts = "; ".join(f"{said} in {', '.join(keys)}" for said, keys in found.items() if keys)
    return f"{reference} against {method}: {parts}."


def to_markdown(table: Table) -> str:
    """A pipe table with intervals; best in bold, published rows in italics."""
    lines = [_pipes(table.header), _pipes("---" for _ in table.header)]
    for row in table.rows:
        texts = (f"**{cell.text}**" if cell.best else cell.text for cell in row)
        lines.append(
            _pipes(
                f"{text} [{cell.interval}]" if cell.interval else text
                for text, cell in zip(texts, row, strict=True)
            )
        )
    lines += [_pipes(f"*{cell.text}*" for cell in row) for row in table.published]
    lines += ["", *(f"- {note}" for note in table.notes)] if table.notes else []
    return "\n".join(lines)


def to_html(table: Table) -> str:
    """The same for the report; intervals are in small type."""
    lines = [f"<tr>{''.join(f'<th>{escape(title)}</th>' for title in table.header)}</tr>"]
    for row, style in (*product(table.rows, [""]), *product(table.published, [" class=published"])):
        cells = "".join(
            f"<td{' class=best' if cell.best else ''}>{escape(cell.text)}"
            f"{f'<small>{escape(cell.interval)}</small>' if cell.interval else ''}</td>"
            for cell in row
        )
        lines.append(f"<tr{style}>{cells}</tr>")
    notes = "".join(f"<p>{escape(note)}</p>" for note in table.notes)
    return "<table>\n" + "\n".join(lines) + "\n</table>" + notes


def to_latex(tables: Sequence[Table]) -> str:
    """All areas in one booktabs table, the paper's columns: no images, times and intervals."""
    columns = tables[0].header[2:-2]
    lines = [
        rf"\begin{{tabular}}{{ll{'c' * len(columns)}}}",
        r"\toprule",
        _ampersands(map(_escape_latex, ("Method", "Evaluation area", *columns))),
    ]
    for table in tables:
        lines.append(r"\midrule")
        for row, style in (*product(table.rows, [""]), *product(table.published, ["textit"])):
            name, _, *figures = row[:-2]
            cells = (Cell(name.text), Cell(table.area), *figures)
            lines.append(_ampersands(_latex(cell, style) for cell in cells))
    lines += [r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def _latex(cell: Cell, style: str) -> str:
    style, text = "textbf" if cell.best else style, _escape_latex(cell.text)
    return rf"\{style}{{{text}}}" if style else text


def _escape_latex(text: str) -> str:
    for character, replacement in _LATEX.items():
        text = text.replace(character, replacement)
    return text


def _ampersands(texts: Iterable[str]) -> str:
    return " & ".join(texts) + r" \\"


def _pipes(texts: Iterable[str]) -> str:
    return f"| {' | '.join(texts)} |"


def _cell(row: Mapping[str, Any], key: str, best: float | None) -> Cell:
    value = row.get(key)
    low, high = row["interval"].get(key, (None, None))
    interval = "" if low is None else f"{_number(low)}, {_number(high)}"
    is_best = best is not None and value == best and not row["failed"]
    return Cell(_number(value), interval, is_best)


def _best(key: str, values: Sequence[float]) -> float | None:
    """The best value, if there is one."""
    if key in _SETPOINTS or not values:
        return None
    return max(values) if "↑" in _TITLES[key] else min(values)


def _number(value: float | None, digits: int = 4) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
