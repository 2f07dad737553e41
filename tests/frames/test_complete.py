"""A frame in, its completion and its record out, with a completer that needs no checkpoint."""

import json
from dataclasses import replace

import pytest
import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame, make_frame
from steered_marigold.errors import InputError, NoMeasurementsError
from steered_marigold.frames.complete import complete_frame
from tests.frames.completers import HEIGHT, WIDTH, NearestCompleter, SilentCompleter

VALUES = {
    *("frame", "method", "steers", "seed", "seconds", "metric", "scale", "shift"),
    *("depth_min_m", "depth_max_m", "exact_codec_steps", "linear_codec_steps"),
    *("input_valid_fraction", "trusted", "untrusted", "floored", "beyond_range"),
    *("not_positive", "too_uncertain"),
    "treated_as_missing",
}


@pytest.fixture
def frame() -> Frame:
    """A random frame, half of it measured."""
    generator = torch.Generator().manual_seed(0)
    image = torch.randint(256, (HEIGHT, WIDTH, 3), dtype=torch.uint8, generator=generator)
    depth = 0.5 + 4 * torch.rand(HEIGHT, WIDTH, generator=generator)
    mask = torch.rand(HEIGHT, WIDTH, generator=generator) < 0.5
    return replace(make_frame(image, depth, mask, id="f"), missing={"zero": int((~mask).sum())})


def test_the_record_says_what_happened(completer: NearestCompleter, frame: Frame) -> None:
    completion, record = complete_frame(completer, frame, seed=3)
    values, depth = record.values, completion.depth[0]
    assert values.keys() == VALUES | completer.describe().keys()
    assert (depth - frame.sparse_depth)[frame.valid_mask].abs().max() <= 1e-3
    assert values["input_valid_fraction"] == pytest.approx(frame.valid_mask.float().mean())
    assert (values["depth_min_m"], values["depth_max_m"]) == (depth.min(), depth.max())
    assert (values["metric"], values["scale"], values["shift"]) == (True, 4.0, 0.5)
    assert (values["frame"], values["seed"], values["steps"]) == ("f", 3, 1)
    assert (values["trusted"], values["untrusted"]) == (int(frame.valid_mask.sum()), 0)
    none = {"beyond_limits": 0, "repeated": 0, "absurd": 0}
    assert values["treated_as_missing"] == {**frame.missing, **none}
    assert record.notices == ()
    assert json.loads(json.dumps(record.to_json(), allow_nan=False)) == {**values, "notices": []}


def test_notices_of_the_frame_and_of_the_answer_are_told(
    completer: NearestCompleter, frame: Frame
) -> None:
    class Contradicted(NearestCompleter):
        def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
            answer = super()._complete(frame, generator)
            return replace(answer, slope_rejected=torch.tensor([True]))

    far = make_frame(frame.image, 300 + frame.sparse_depth, frame.valid_mask)
    _, record = complete_frame(Contradicted(), far)
    assert [notice.kind for notice in record.notices] == ["implausible_scale", "slope_rejected"]
    _, record = complete_frame(completer, frame)
    extended = record.extended({"seed": 9, "points": 1}, *far.notices)
    assert extended.values == {**record.values, "seed": 9, "points": 1}
    assert extended.to_json()["notices"] == [vars(notice) for notice in far.notices]


def test_a_seed_gives_the_same_answer_and_another_seed_another(
    completer: NearestCompleter, frame: Frame
) -> None:
    a, b, c = (complete_frame(completer, frame, seed=seed)[0].depth for seed in (1, 1, 2))
    assert torch.equal(a, b)
    assert not torch.equal(a, c)


def test_what_is_too_uncertain_is_unknown(completer: NearestCompleter, frame: Frame) -> None:
    completion, record = complete_frame(completer, frame, max_uncertainty=0.01)
    assert completion.uncertainty is not None
    unsure = completion.uncertainty > 0.01
    assert 0 < record.values["too_uncertain"] == int(unsure.sum()) < unsure.numel()
    assert torch.equal(completion.depth > 0, ~unsure)
    assert record.values["depth_min_m"] > 0
    for bound in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="`max_uncertainty` must be a positive number"):
            complete_frame(completer, frame, max_uncertainty=bound)


def test_uncertainty_that_nobody_estimated_cannot_be_had(
    silent_completer: SilentCompleter, frame: Frame
) -> None:
    with pytest.raises(InputError, match="`ensemble_size=4`"):
        complete_frame(silent_completer, frame, max_uncertainty=0.1)
    values = complete_frame(silent_completer, frame)[1].values
    assert (values["scale"], values["shift"], values["floored"]) == (None, None, 0)


def test_confidence_is_passed_on(completer: NearestCompleter, frame: Frame) -> None:
    confidence = torch.ones(HEIGHT, WIDTH)
    confidence[:, :16] = 0
    _, record = complete_frame(completer, replace(frame, confidence=confidence))
    assert record.values["untrusted"] == int(frame.valid_mask[:, :16].sum()) > 0


def test_nothing_measured(completer: NearestCompleter, frame: Frame) -> None:
    nothing = frame.keep(torch.zeros_like(frame.valid_mask))
    with pytest.raises(NoMeasurementsError, match="nearest"):
        complete_frame(completer, nothing)
    completion, record = complete_frame(completer, nothing, no_measurements=True)
    relative = frame.image.float().mean(dim=2) / 255
    torch.testing.assert_close(completion.depth[0], relative)
    values = record.values
    assert (values["metric"], values["depth_min_m"], values["scale"]) == (False, None, None)
    json.dumps(record.to_json(), allow_nan=False)
    with pytest.raises(InputError, match="relative"):
        complete_frame(completer, nothing, no_measurements=True, max_uncertainty=1.0)


def test_permission_to_do_without_measurements_does_not_drop_them(
    completer: NearestCompleter, frame: Frame
) -> None:
    with_permission, record = complete_frame(completer, frame, no_measurements=True)
    assert record.values["metric"]
    assert torch.equal(with_permission.depth, complete_frame(completer, frame)[0].depth)
