"""Knobs are declared once; presets are named sets of them."""

import subprocess
import sys
from inspect import Parameter, signature
from typing import Any, Literal, get_args, get_origin

import pytest

from steered_marigold.core.consistency import SensorNoise
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.diffusion.settings import KNOBS, PLAIN, PRESETS, Preset, get_preset
from steered_marigold.errors import InputError

# what a call takes beside the knobs
OTHERS = {
    *("self", "image", "sparse_depth", "valid_mask", "preset", "sensor_noise", "confidence"),
    *("generator", "latents", "previous_latents", "restart", "output_type", "output_latents"),
    *("return_dict", "callback_on_step_end", "callback_on_step_end_tensor_inputs"),
}


def _another(kind: Any, value: Any) -> Any:
    """Another value of a knob's type."""
    if get_origin(kind) is Literal:
        return next(word for word in get_args(kind) if word != value)
    if kind is float:
        return value + 0.5
    return not value if kind is bool else (value or 0) + 1


def _kinds(hint: object) -> set[object]:
    """What a value that is not None may be; words of a Literal, else types."""
    return {kind for kind in _parts(hint) if kind is not type(None)}


def _parts(hint: object) -> tuple[object, ...]:
    return tuple(part for arg in get_args(hint) for part in _parts(arg)) or (hint,)


def test_the_pipelines_call_has_exactly_the_knobs_with_their_types() -> None:
    parameters = signature(SteeredMarigoldPipeline.__call__, eval_str=True).parameters
    assert parameters.keys() == OTHERS | KNOBS.keys()
    for name, hint in KNOBS.items():
        parameter = parameters[name]
        assert parameter.kind is Parameter.KEYWORD_ONLY
        assert parameter.default is None
        assert type(None) in get_args(parameter.annotation)
        assert _kinds(parameter.annotation) == _kinds(hint), name


@pytest.mark.parametrize("name", KNOBS)
@pytest.mark.parametrize("preset", [PLAIN, *PRESETS.values()])
def test_a_knob_that_is_turned_turns_alone(preset: Preset, name: str) -> None:
    other = _another(KNOBS[name], preset.knobs[name])
    turned = preset.override(**{name: other})
    assert turned.knobs == preset.knobs | {name: other} != preset.knobs
    assert preset.override(**{name: None}) == preset


def test_knobs_of_the_papers_are_the_authors() -> None:
    knobs = PRESETS["paper"].knobs
    assert (knobs["steering_strength"], knobs["neighborhood_px"]) == (0.1, 7)
    assert (knobs["anchor_fraction"], knobs["num_inference_steps"]) == (0.05, 50)


def test_names() -> None:
    assert list(PRESETS) == ["default", "fast", "paper", "paper-minmax"]
    assert get_preset(None) == PLAIN == Preset()
    assert PLAIN.steering.steering_strength == 0
    assert get_preset("fast") is PRESETS["fast"]
    assert get_preset(PRESETS["paper"]) is PRESETS["paper"]
    with pytest.raises(InputError, match="unknown preset 'best': choose one of default, fast"):
        get_preset("best")
    with pytest.raises(InputError, match="no setting is called 'speed'; there are: steering_str"):
        PLAIN.override(speed=1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steering_strength", -0.1),
        ("steering_strength", float("nan")),
        ("neighborhood_px", -1),
        ("anchor_fraction", 1.5),
        ("max_anchors", 0),
        ("ensemble_size", 0),
        ("num_inference_steps", 0),
        ("processing_resolution", -1),
    ],
)
def test_values_that_no_knob_has(name: str, value: object) -> None:
    with pytest.raises(InputError, match=f"`{name}`"):
        PRESETS["default"].override(**{name: value})


def test_words_that_no_knob_knows() -> None:
    """In a process of its own: here types are checked before the package sees the word."""
    program = """
from steered_marigold.diffusion.settings import PRESETS
PRESETS["default"].override(steering_codec="none")
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert "InputError: `steering_codec` is 'none': choose one of exact, tiny, linear" in run.stderr


@pytest.mark.parametrize("noise", [{"metres": -0.1}, {"fraction": float("nan")}])
def test_noise_that_no_sensor_has(noise: dict[str, float]) -> None:
    with pytest.raises(InputError, match="SensorNoise"):
        SensorNoise(**noise)
