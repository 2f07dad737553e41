import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from steered_marigold.evaluation.protocols import Protocol
from steered_marigold.evaluation.published import ERASED, UNIFORM, published_rows
from steered_marigold.evaluation.report import extreme_frames, write_outputs
from steered_marigold.evaluation.runner import Run, run_evaluation
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.evaluation.statistics import PairedDifference
from steered_marigold.evaluation.summary import METRICS, compare, summarize
from steered_marigold.evaluation.tables import area_table, comparison_table, to_latex, to_markdown
from steered_marigold.methods.completer import DepthCompleter

PAPER = Path(__file__).resolve().parents[3] / "shared" / "paper" / "steered_marigold.tex"
ROW_KEYS = {
    "method",
    "runs_as",
    "protocol",
    "area",
    "images",
    "failed",
    *METRICS,
    "seconds_per_image",
}


@pytest.fixture(scope="module")
def finished(tiny: RunSettings, tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Path]:
    """A run of nearest and linear with all its files."""
    folder = tmp_path_factory.mktemp("run")
    run = run_evaluation(tiny, folder)
    write_outputs(run, folder)
    return run, folder


def test_summary_has_its_schema_and_agrees_with_the_images(finished: tuple[Run, Path]) -> None:
    _, folder = finished
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary) == {"run", "rows"}
    images = pd.read_csv(folder / "per_image.csv")
    assert len(images) == 4 * 2 * 3
    assert len(summary["rows"]) == 2 * 3
    for row in summary["rows"]:
        assert set(row) >= ROW_KEYS | {"interval"}
        assert row["protocol"] == "lidar-8"
        chosen = images[(images.method == row["method"]) & (images.area == row["area"])]
        assert row["images"] == len(chosen) == 4
        for key in METRICS:
            assert row[key] == pytest.approx(chosen[key].mean(), abs=1e-12)
            low, high = row["interval"][key]
            assert low <= row[key] <= high
        assert row["seconds_per_image"] == pytest.approx(chosen.seconds.mean())
    assert set(images.columns) >= {"delta2", "delta3", "valid_pixels", "max_deviation_m"}


def test_comparisons_pair_the_images(finished: tuple[Run, Path]) -> None:
    run, folder = finished
    images = pd.read_csv(folder / "per_image.csv").set_index("frame")
    written = pd.read_csv(folder / "comparisons.csv").set_index(["area", "metric"])
    hidden = images[images.area == "hidden"]
    by_method = {name: rows.rmse_m for name, rows in hidden.groupby("method")}
    expected = (by_method["linear"] - by_method["nearest"]).mean()
    paired = compare(run, area="hidden")["linear", "rmse_m"]
    assert paired.difference == pytest.approx(expected)
    assert written.difference["hidden", "rmse_m"] == pytest.approx(expected)
    assert set(written.reference) == {"nearest"}


def test_every_method_is_compared_with_the_reference_in_every_area(
    finished: tuple[Run, Path],
) -> None:
    _, folder = finished
    written = pd.read_csv(folder / "comparisons.csv")
    assert len(written) == 3 * len(METRICS)
    assert set(written.verdict) == {"not distinguishable"}  # of four images
    text = (folder / "table.md").read_text()
    line = "- nearest against linear: not distinguishable in REL, δ1, RMSE, MAE."
    assert text.count(line) == 3
    assert (folder / "report.html").read_text().count(f"<p>{line[2:]}</p>") == 3


def test_the_verdict_knows_which_way_is_better() -> None:
    def paired(difference: float, images: int = 9) -> PairedDifference:
        low, high = difference - 0.1, difference + 0.1
        return PairedDifference(difference=difference, low=low, high=high, images=images)

    compared = {
        ("linear", "abs_rel"): paired(1.0),
        ("linear", "delta1"): paired(1.0),
        ("linear", "rmse_m"): paired(-1.0),
        ("linear", "mae_m"): paired(0.0),
        ("telea", "abs_rel"): paired(1.0, images=5),
        ("telea", "delta1"): paired(-1.0),
    }
    assert comparison_table(compared, "full", "default").notes == (
        "default against linear: better in REL; worse in δ1, RMSE; not distinguishable in MAE.",
        "default against telea: better in δ1; not distinguishable in REL.",
    )


def test_best_is_bold_and_columns_have_the_papers_order(finished: tuple[Run, Path]) -> None:
    run, folder = finished
    rows = json.loads((folder / "summary.json").read_text())["rows"]
    hidden = {row["method"]: row for row in rows if row["area"] == "hidden"}
    table = area_table(run.settings, rows, "hidden")
    assert table.header[:2] == ("method", "runs as")
    assert [title.split()[0] for title in table.header[2:6]] == ["REL", "δ1", "RMSE", "MAE"]
    for row in table.rows:
        for key, cell in zip(METRICS, row[2:6], strict=True):
            values = [hidden[method][key] for method in ("nearest", "linear")]
            best = max(values) if key == "delta1" else min(values)
            assert cell.best == (hidden[row[0].text][key] == best)
            assert float(cell.text) == pytest.approx(hidden[row[0].text][key], abs=5e-5)
    assert "**" in to_markdown(table)
    latex = to_latex([table])
    assert (folder / "table.tex").read_text().count(r"\midrule") == 3
    assert re.search(r"REL \$\\downarrow\$ & \$\\delta_1\$ \$\\uparrow\$ & RMSE", latex)
    for line in latex.splitlines()[4:-2]:
        assert line.count("&") == 5
        assert line.endswith(r"\\")


def test_report_stands_alone(finished: tuple[Run, Path]) -> None:
    _, folder = finished
    html = (folder / "report.html").read_text()
    assert html.count('src="data:image/jpeg;base64,') == 4
    assert not re.findall(r'(?:src|href)="(?!data:)', html)
    assert "worst frame" in html
    assert "best frame" in html


def test_extreme_frames_are_the_worst_and_the_best(finished: tuple[Run, Path]) -> None:
    run, _ = finished
    values = {x.frame_id: x.areas["hidden"]["abs_rel"] for x in run.results["nearest"]}
    ranked = sorted(values, key=lambda frame: values[frame])
    captions = extreme_frames(run)
    assert list(captions) == [ranked[3], ranked[2], ranked[0], ranked[1]]
    assert captions[ranked[3]].startswith("worst")
    assert captions[ranked[0]].startswith("best")


def test_failures_and_absent_methods_are_told(
    tiny: RunSettings,
    tmp_path: Path,
    failing_on: Callable[[Path], Callable[[str], DepthCompleter]],
) -> None:
    settings = replace(tiny, methods=("wrapped", "bpnet"))
    create = failing_on(tiny.path / "rgb" / "f1.png")
    run = run_evaluation(settings, tmp_path, create=create)
    write_outputs(run, tmp_path, create=create)
    for name in ("table.md", "report.html"):
        text = (tmp_path / name).read_text()
        assert "3 (1 failed)" in text
        assert "wrapped, frame f1 failed" in text
        assert "bpnet was left out" in text
        assert "**" not in text
        assert "class=best" not in text
    assert "coverage of 90 %" in (tmp_path / "table.md").read_text()


def test_kitti_has_its_own_units(finished: tuple[Run, Path]) -> None:
    run, folder = finished
    kitti = replace(run, settings=replace(run.settings, dataset="kitti"))
    summary = summarize(kitti)
    images = pd.read_csv(folder / "per_image.csv")
    row = next(row for row in summary["rows"] if (row["method"], row["area"]) == ("linear", "full"))
    chosen = images[(images.method == "linear") & (images.area == "full")]
    assert row["rmse_mm"] == pytest.approx(1000 * chosen.rmse_m.mean())
    assert row["irmse_per_km"] == pytest.approx(chosen.irmse_per_km.mean())
    assert "iRMSE [1/km] ↓" in area_table(kitti.settings, summary["rows"], "full").header


def test_published_rows_are_the_papers() -> None:
    if not PAPER.is_file():
        pytest.skip("the paper's source is not on this machine")
    text = PAPER.read_text().replace(r"\textbf{", "").replace("}", "")
    for row in (*UNIFORM, *ERASED):
        numbers = (row.abs_rel, row.delta1, row.rmse_m, row.mae_m)
        figures = r"\s*&\s*".join(f"{number:.4f}" for number in numbers)
        width, height = row.area.split("x")
        pattern = rf"{width}\\times{height}\$\s*&\s*\$?{row.points}[^\n]*?&\s*{figures}\s*\\\\"
        assert len(re.findall(pattern, text)) == 1, row
    assert (len(UNIFORM), len(ERASED)) == (11, 24)


def test_published_rows_stand_beside_nyuv2_test_frames_alone(tiny: RunSettings) -> None:
    nyuv2 = replace(tiny, dataset="nyuv2", protocol=Protocol(kind="paper-erased"))
    assert len(published_rows(nyuv2, "408x248")) == 8
    assert not published_rows(replace(nyuv2, split="train"), "408x248")
    assert not published_rows(replace(nyuv2, ground_truth="inpainted"), "408x248")
    assert not published_rows(replace(nyuv2, dataset="folder"), "408x248")
    assert not published_rows(replace(nyuv2, protocol=Protocol(kind="range")), "full")
    table = area_table(nyuv2, [], "408x248")
    assert all("(published)" in row[0].text for row in table.published)
    assert "*0.0510*" in to_markdown(table)
    assert r"\textit{0.0510}" in to_latex([table])
