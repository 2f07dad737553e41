"""The files of a finished run: figures, tables, and a page to look at."""

import base64
import json
from collections.abc import Iterator, Mapping
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from steered_marigold.evaluation.pictures import example_answers, frame_picture
from steered_marigold.evaluation.predictions import Predictions
from steered_marigold.evaluation.runner import Evaluator, Run
from steered_marigold.evaluation.settings import MethodFactory
from steered_marigold.evaluation.summary import (
    compare,
    image_values,
    reference_method,
    summarize,
    write_comparisons,
    write_images,
    write_summary,
)
from steered_marigold.evaluation.tables import (
    Table,
    area_table,
    comparison_table,
    to_html,
    to_latex,
    to_markdown,
)
from steered_marigold.io.files import atomic_write

_EXTREMES = 2
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 1500px; padding: 0 1em }
table { border-collapse: collapse; margin: 1em 0 }
th, td { padding: .25em .7em; text-align: right; border-bottom: 1px solid #ddd }
th:first-child, td:first-child { text-align: left }
td small { display: block; color: #777 }
.best { font-weight: bold } .published { font-style: italic; color: #555 }
img { max-width: 100% } pre { background: #f6f6f6; padding: 1em; overflow: auto }
"""


def write_outputs(run: Run, folder: Path, *, create: MethodFactory | None = None) -> None:
    """Writes summary.json, per_image.csv, comparisons.csv, table.md, table.tex and report.html.

    The report's pictures show the answers that the run kept in the folder. Where there are none,
    methods complete the frame once more; `create` makes them, as in `run_evaluation`.
    """
    areas = run.settings.protocol.areas
    summary = summarize(run)
    compared = {area: compare(run, area=area) for area in areas}
    write_summary(summary, folder)
    write_images(run, folder)
    write_comparisons(run, compared, folder)
    tables = [area_table(run.settings, summary["rows"], area) for area in areas]
    reference = reference_method(run.results)
    differences = [comparison_table(compared[area], area, reference) for area in areas]
    _write(folder / "table.md", _markdown(run, tables, differences))
    _write(folder / "table.tex", to_latex(tables))
    pictures = _extreme_pictures(run, folder, create)
    _write(folder / "report.html", _html(run, summary, tables, differences, pictures))


def extreme_frames(run: Run) -> dict[str, str]:
    """The worst and the best frames of the reference method, and what to say of each."""
    area = run.settings.protocol.focus
    values = image_values(run, reference_method(run.results), area, "abs_rel")
    ranked = sorted(values, key=lambda frame_id: (-values[frame_id], frame_id))
    worst, best = ranked[:_EXTREMES], ranked[_EXTREMES:][-_EXTREMES:]
    return {
        frame_id: f"{kind} frame {frame_id}: REL {values[frame_id]:.4f} in {area}"
        for kind, frames in (("worst", worst), ("best", best[::-1]))
        for frame_id in frames
    }


def _extreme_pictures(run: Run, folder: Path, create: MethodFactory | None) -> dict[str, Figure]:
    """Pictures of the extreme frames by their captions."""
    captions = extreme_frames(run)
    evaluator = Evaluator(run.settings, create, Predictions(run.settings, folder))
    answers = example_answers(evaluator, run.results, list(captions))
    return {
        caption: frame_picture(evaluator.prepare(frame_id), answers[frame_id])
        for frame_id, caption in captions.items()
    }


def _markdown(run: Run, tables: list[Table], differences: list[Table]) -> str:
    parts = [_headline(run), *_remarks(run)]
    for title, table in _sections(run, tables, differences):
        parts += [f"### {title}", to_markdown(table)]
    parts += [f"- {line}" for line in _missing(run)]
    return "\n\n".join(parts) + "\n"


def _html(
    run: Run,
    summary: Mapping[str, Any],
    tables: list[Table],
    differences: list[Table],
    pictures: Mapping[str, Figure],
) -> str:
    parts = [f"<h1>{escape(_headline(run))}</h1>"]
    parts += [f"<p>{escape(remark)}</p>" for remark in _remarks(run)]
    for title, table in _sections(run, tables, differences):
        parts += [f"<h2>{escape(title)}</h2>", to_html(table)]
    missing = "".join(f"<li>{escape(line)}</li>" for line in _missing(run))
    parts += [f"<h2>Not in the tables</h2><ul>{missing}</ul>"] if missing else []
    for caption, picture in pictures.items():
        parts += [
            f"<h2>{escape(caption)}</h2>",
            f'<img alt="{escape(caption)}" src="{_data(picture)}">',
        ]
    parts += [f"<h2>Settings</h2><pre>{escape(json.dumps(summary['run'], indent=1))}</pre>"]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(_headline(run))}'
        f"</title><style>{_STYLE}</style>\n" + "\n".join(parts) + "\n</html>\n"
    )


def _headline(run: Run) -> str:
    settings = run.settings
    return f"{settings.dataset}, {settings.protocol.name}, {len(settings.frames)} frames"


def _remarks(run: Run) -> list[str]:
    """What a reader of the tables needs to know."""
    remarks = ["In brackets: 95 % bootstrap interval over images. Bold: best of the measured rows."]
    if run.settings.protocol.bordered:
        remarks.append(
            "seam: how much more log depth steps at the border of the known area than beside it, "
            "beyond what the truth does, over the whole image; 0 is none."
        )
    if run.settings.official_metrics:
        remarks.append("δ1 as in the authors' script: a negative prediction counts as an inlier.")
    return remarks


def _sections(
    run: Run, tables: list[Table], differences: list[Table]
) -> Iterator[tuple[str, Table]]:
    """All tables with their titles."""
    for table in tables:
        yield f"Area {table.area}", table
    for table in differences:
        if table.rows:
            title = f"Paired difference to {reference_method(run.results)}, area {table.area}"
            yield f"{title} (bold: the interval leaves out 0, of at least 6 images)", table


def _missing(run: Run) -> list[str]:
    """What has no figures, and why."""
    failed = [f"{x.method}, frame {x.frame_id} failed: {x.error}" for x in run.failures]
    return failed + [f"{method} was left out: {why}" for method, why in run.left_out.items()]


def _data(picture: Figure) -> str:
    """A figure as a data URL."""
    buffer = BytesIO()
    picture.savefig(buffer, format="jpeg", pil_kwargs={"quality": 85})
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
