"""How well stated uncertainties describe the errors of a run."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from steered_marigold.core.metrics import (
    COVERAGE_LEVELS,
    DROPPED_SHARES,
    UncertaintyCurves,
    exact_mean,
)
from steered_marigold.evaluation.results import ResultLog
from steered_marigold.evaluation.settings import RunSettings


def kept_curves(run: Path, settings: RunSettings) -> dict[str, UncertaintyCurves]:
    """The mean over the run's images, by method, of those that state an uncertainty."""
    results = ResultLog(run / "results.jsonl").read()
    found = {
        label: [
            result.curves
            for frame in settings.frames
            if (result := results.get((label, frame))) is not None and result.curves is not None
        ]
        for label in settings.methods
    }
    return {label: _mean(curves) for label, curves in found.items() if curves}


def calibration_figure(curves: Mapping[str, UncertaintyCurves], area: str) -> Figure | None:
    """Coverage against the nominal one, and sparsification curves; None without methods.

    Left: on the diagonal an uncertainty is right; below it, it is too small. Right: MAE of the
    pixels that are left, over that of all, when the most uncertain go first (full) and when the
    largest errors do (dashed). The area between the two is the AUSE.
    """
    if not curves:
        return None
    figure = Figure(figsize=(9, 4), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    coverage, sparsification = figure.subplots(1, 2)
    coverage.plot((0, 1), (0, 1), color="0.6", linewidth=1)
    for index, (label, curve) in enumerate(curves.items()):
        style = {"color": f"C{index}", "linewidth": 1.3}
        coverage.plot(COVERAGE_LEVELS, curve.coverage, marker=".", label=label, **style)
        sparsification.plot(DROPPED_SHARES, curve.by_uncertainty, label=label, **style)
        sparsification.plot(DROPPED_SHARES, curve.by_error, linestyle="--", **style)
    coverage.set(
        xlabel="nominal coverage", ylabel="share of pixels", title=f"calibration, area {area}"
    )
    coverage.legend(fontsize=7)
    sparsification.set(xlabel="share of pixels dropped", ylabel="MAE / MAE of all pixels")
    sparsification.set(title="sparsification, dashed: by true error", ylim=(0, None))
    return figure


def _mean(images: Sequence[Mapping[str, Sequence[float]]]) -> UncertaintyCurves:
    """Point by point, each image counting once."""
    return UncertaintyCurves(
        **{
            name: tuple(map(exact_mean, zip(*(image[name] for image in images), strict=True)))
            for name in ("coverage", "by_uncertainty", "by_error")
        }
    )
