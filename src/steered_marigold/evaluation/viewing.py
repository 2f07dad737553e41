"""A run of an evaluation, to be looked at: all answers of a frame beside its truth."""

from pathlib import Path

from steered_marigold.evaluation.predictions import Predictions
from steered_marigold.evaluation.runner import Evaluator, Run
from steered_marigold.frames.viewing import rerun_log, written_answer

TRUTH = "truth"


def view_run(run: Run, folder: Path, path: Path) -> int:
    """Writes the frames of a run with the answers that `folder` keeps to `path`, .rrd.

    Returns how many frames there are: those of which an answer was kept. Raises what `rerun_log`
    raises.
    """
    predictions = Predictions(run.settings, folder)
    evaluator = Evaluator(run.settings, predictions=predictions)
    count = 0
    with rerun_log(path, (*run.results, TRUTH)) as viewing:
        for frame_id in run.settings.frames:
            kept = {label: predictions.read(label, frame_id) for label in run.results}
            depths = {label: depth for label, depth in kept.items() if depth is not None}
            if depths:
                frame = evaluator.prepare(frame_id)
                depths[TRUTH] = frame.metric_depth
                answers = {x: written_answer(frame.shown, depths[x]) for x in depths}
                viewing.compare(frame.shown, answers)
                count += 1
    return count
