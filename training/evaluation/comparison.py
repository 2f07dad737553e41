"""Errors of the checkpoint as a method: by number of steps, and steered against unsteered."""

from collections.abc import Mapping, Sequence

from steered_marigold.errors import SteeredMarigoldError
from steered_marigold.evaluation.runner import Evaluator
from steered_marigold.evaluation.settings import RunSettings
from steered_marigold.evaluation.statistics import paired_comparison
from training.evaluation.drift import ALIGNMENTS, draw_drift
from training.evaluation.subject import Findings, Row, Subject, mean_row

WHOLE, ERASED = "608x448", "408x248"
COMPARED = ("abs_rel", "rmse_m")
# by frame id
Scores = Mapping[str, Row]


def steps(subject: Subject) -> Findings:
    """Unsteered, by number of steps, over the whole crop."""
    labels = {f"marigold@num_inference_steps={n}": n for n in subject.steps}
    scores = score(subject.run("paper-uniform", tuple(labels)), WHOLE)
    rows = [
        {"steps": n, **means(scores[label], ("abs_rel", "delta1", "rmse_m"))}
        for label, n in labels.items()
    ]
    return Findings({f"unsteered, fitted on the 5 % samples, area {WHOLE}": rows})


def steering(subject: Subject) -> Findings:
    """Preset `paper` against the same without steering, in the erased area; and its drift."""
    base = f"paper@num_inference_steps={subject.steps[-1]}"
    unsteered = f"{base},steering_strength=0"
    steered = {f"{base},condition_alignment={kind}": kind for kind in ALIGNMENTS}
    scores = score(subject.run("paper-erased", (unsteered, *steered)), ERASED)
    rows = [
        {"condition_alignment": name, **means(scores[label], COMPARED)}
        for label, name in {unsteered: "unsteered", **steered}.items()
    ]
    reference = scores[unsteered]
    differences = [
        {"condition_alignment": name, "metric": key, **_difference(scores[label], reference, key)}
        for label, name in steered.items()
        for key in COMPARED
    ]
    drift, picture = draw_drift(subject, steered)
    area = f"preset paper, {subject.steps[-1]} steps, area {ERASED}"
    return Findings(
        {
            area: rows,
            f"{area}: steered - unsteered, 95 % interval": differences,
            "scale and shift of the condition to the last x0, and to the truth": drift,
        },
        (picture,),
    )


def score(run: RunSettings, area: str) -> dict[str, Scores]:
    """Errors in an area, by method and frame. Raises SteeredMarigoldError if one has no answer."""
    evaluator = Evaluator(run)
    scores: dict[str, Scores] = {}
    for label in run.methods:
        results = [evaluator.evaluate(label, frame_id) for frame_id in run.frames]
        for result in results:
            if result.error is not None:
                raise SteeredMarigoldError(f"{label} on frame {result.frame_id}: {result.error}")
        scores[label] = {result.frame_id: dict(result.areas[area]) for result in results}
    return scores


def means(scores: Scores, keys: Sequence[str]) -> Row:
    """The mean of each metric over the frames."""
    return mean_row([{key: row[key] for key in keys} for row in scores.values()])


def _difference(first: Scores, second: Scores, key: str) -> Row:
    values = ({frame: row[key] for frame, row in scores.items()} for scores in (first, second))
    found = paired_comparison(*values)
    return {
        "difference": found.difference,
        "low": found.low,
        "high": found.high,
        "significant": found.significant,
    }
