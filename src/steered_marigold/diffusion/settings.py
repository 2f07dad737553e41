"""Every knob of a run, declared once, in groups; and the presets, which are named sets of them.

A knob is a field of `Steering`, `Sampling` or `Finishing` below. From here `from_checkpoint`,
`create_method`, the command line's `--set` and the table in the docs take names, types and values;
`SteeredMarigoldPipeline.__call__` spells the names out once more, and a test holds the two equal.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from math import inf
from typing import Any, Literal, get_args, get_origin, get_type_hints

from steered_marigold.core.finishing import Finishing
from steered_marigold.core.steering import ConditionAlignment
from steered_marigold.core.uncertainty import UncertaintyModel
from steered_marigold.errors import InputError

# how steering decodes and encodes: by the VAE, `steering_vae`, or a linear map fitted in the run
SteeringCodec = Literal["exact", "tiny", "linear"]


def _require_range(name: str, value: int | float | None, least: int, most: int | float) -> None:
    """InputError for a number outside of these; None stands for something else."""
    if value is not None and not (least <= value <= most and value < inf):
        limits = f"at least {least:g}" if most == inf else f"from {least:g} to {most:g}"
        raise InputError(f"`{name}` is {value}: it must be {limits}")


def _require_choices(group: object) -> None:
    """InputError for a word that is none of those that a field's type lists."""
    for name, kind in get_type_hints(type(group)).items():
        value = getattr(group, name)
        if get_origin(kind) is Literal and value not in get_args(kind):
            choices = ", ".join(get_args(kind))
            raise InputError(f"`{name}` is {value!r}: choose one of {choices}")


@dataclass(frozen=True, kw_only=True)
class SteeringKnobs:
    """How predictions are moved towards the measurements while they are denoised (the paper).

    steering_strength: lambda; 0 does not steer. neighborhood_px: zeta [px] and anchor_fraction: the
    share of all pixels drawn as anchors, both on the processing grid. anchors: drawn once, or anew
    in every step. max_anchors: thins the measurements that steer; None keeps all.
    condition_alignment: by least squares to each step's prediction, or once by the measurements'
    own range. steering_codec: "exact" steers through the VAE, "tiny" through `steering_vae`,
    "linear" through a linear map that is fitted and checked in the run.
    """

    steering_strength: float = 0.0
    neighborhood_px: int = 7
    anchor_fraction: float = 0.05
    anchors: Literal["fixed", "redraw"] = "fixed"
    max_anchors: int | None = None
    condition_alignment: ConditionAlignment = "least_squares"
    steering_codec: SteeringCodec = "exact"

    def __post_init__(self) -> None:
        _require_range("steering_strength", self.steering_strength, 0, inf)
        _require_range("neighborhood_px", self.neighborhood_px, 0, inf)
        _require_range("anchor_fraction", self.anchor_fraction, 0, 1)
        _require_range("max_anchors", self.max_anchors, 1, inf)
        _require_choices(self)


@dataclass(frozen=True, kw_only=True)
class SamplingKnobs:
    """How latents are sampled.

    num_inference_steps None: as many as the checkpoint says. ensemble_size: members to merge.
    mirror: every other member of an even ensemble sees the image mirrored. continuation: denoise a
    second time, told the measured depth, and merge both answers; only with a checkpoint that
    `continues_known`. processing_resolution: the image's longer side inside the model [px]; None:
    the checkpoint's; 0: the image's own, unless the checkpoint has an image encoder, which only
    knows its training resolution.
    """

    num_inference_steps: int | None = None
    ensemble_size: int = 1
    mirror: bool = False
    continuation: bool = False
    processing_resolution: int | None = None

    def __post_init__(self) -> None:
        _require_range("num_inference_steps", self.num_inference_steps, 1, inf)
        _require_range("ensemble_size", self.ensemble_size, 1, inf)
        _require_range("processing_resolution", self.processing_resolution, 0, inf)


@dataclass(frozen=True, kw_only=True)
class FinishingKnobs:
    """How a prediction becomes metric depth.

    robust: fit so that wrong measurements hardly count, and leave them out. consistent: make the
    answer agree with the measurements.
    """

    robust: bool = False
    consistent: bool = False


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A value for every knob, and what belongs to a preset alone.

    scheduler: class name (None: the checkpoint's own) and settings that a local scheduler takes
    instead of the checkpoint's; None leaves the pipeline's scheduler as it is.
    prompt_tokens: length that the empty prompt is padded to, or None for no padding.
    least_share: lower bound of depth as a share of the median measured depth, or None (then depth
    may be negative).
    uncertainty: the calibrated model for answers made consistent, or None: the members' spread.
    dtype: the models' precision where nobody asks for one, by name; "auto" is the device's fastest.
    """

    steering: SteeringKnobs = field(default_factory=SteeringKnobs)
    sampling: SamplingKnobs = field(default_factory=SamplingKnobs)
    finishing: FinishingKnobs = field(default_factory=FinishingKnobs)
    scheduler: tuple[str | None, Mapping[str, Any]] | None = None
    prompt_tokens: int | None = None
    least_share: float | None = None
    uncertainty: UncertaintyModel | None = None
    dtype: str = "float32"

    def override(self, **knobs: Any) -> "Preset":
        """This preset with the knobs that are not None. Raises InputError for unknown ones."""
        require_knobs(knobs)
        groups = {}
        for name in _GROUPS:
            group = getattr(self, name)
            own = {f.name: knobs[f.name] for f in fields(group) if knobs.get(f.name) is not None}
            groups[name] = replace(group, **own)
        return replace(self, **groups)

    @property
    def knobs(self) -> dict[str, Any]:
        """The value of every knob."""
        return {k: v for name in _GROUPS for k, v in vars(getattr(self, name)).items()}

    @property
    def finish(self) -> Finishing:
        """What `core.finishing` reads."""
        return Finishing(
            robust=self.finishing.robust,
            consistent=self.finishing.consistent,
            least_share=self.least_share,
            uncertainty=self.uncertainty,
        )


_GROUPS = {"steering": SteeringKnobs, "sampling": SamplingKnobs, "finishing": FinishingKnobs}
# type of every knob by its name
KNOBS = {name: kind for group in _GROUPS.values() for name, kind in get_type_hints(group).items()}


def require_knobs(names: Mapping[str, Any]) -> None:
    """InputError for a name that is no knob."""
    unknown = [name for name in names if name not in KNOBS]
    if unknown:
        raise InputError(f"no setting is called {unknown[0]!r}; there are: {', '.join(KNOBS)}")


# the pipeline as it is: Marigold, unsteered
PLAIN = Preset()

# the authors' scheduler settings that do not come from the checkpoint (PAPER: DDPM of SD 2)
PAPER_SCHEDULER = {
    "num_train_timesteps": 1000,
    "timestep_spacing": "leading",
    "steps_offset": 1,
    "clip_sample": False,
    "variance_type": "fixed_small",
    "thresholding": False,
}
PAPER = Preset(
    steering=SteeringKnobs(steering_strength=0.1, anchors="redraw"),
    sampling=SamplingKnobs(num_inference_steps=50, processing_resolution=0),
    scheduler=("DDPMScheduler", PAPER_SCHEDULER),
    prompt_tokens=77,
)
# the authors' run on uniform samples skips the alignment by least squares
PAPER_MINMAX = PAPER.override(condition_alignment="minmax")

# coverage of the 90 % interval on the tune split (docs/method.md)
CALIBRATED = UncertaintyModel(
    near=0.00767,
    reach=0.303,
    drift=0.285,
    length=0.0141,
    origin=0.734,
    moved=0.607,
    farther=0.216,
    nearer=0.355,
    relief=14.6,
    by_kind=(0.964, 1.53, 1.9, 2.08),
)
# Unsteered: next to the consistency solve, steering made the erased area worse on the embedded
# checkpoint (docs/method.md has the figures). steering_strength turns it on.
DEFAULT = Preset(
    steering=SteeringKnobs(max_anchors=4000, condition_alignment="minmax", steering_codec="linear"),
    sampling=SamplingKnobs(ensemble_size=2, mirror=True, continuation=True),
    finishing=FinishingKnobs(robust=True, consistent=True),
    least_share=0.02,
    uncertainty=CALIBRATED,
    dtype="auto",
)
FAST = replace(
    DEFAULT,
    steering=replace(DEFAULT.steering, max_anchors=1500),
    sampling=SamplingKnobs(num_inference_steps=1),
    scheduler=(None, {"timestep_spacing": "trailing"}),
)
PRESETS = {"default": DEFAULT, "fast": FAST, "paper": PAPER, "paper-minmax": PAPER_MINMAX}


def get_preset(name: str | Preset | None) -> Preset:
    """The preset of that name; None is the pipeline as it is. Raises InputError for others."""
    if isinstance(name, Preset):
        return name
    if name is None:
        return PLAIN
    if name not in PRESETS:
        raise InputError(f"unknown preset {name!r}: choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
