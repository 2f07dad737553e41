"""Named sets of call arguments."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from steered_marigold.core.finishing import Finishing
from steered_marigold.core.steering import ConditionAlignment
from steered_marigold.core.uncertainty import UncertaintyModel
from steered_marigold.errors import InputError

# the authors' scheduler settings that do not come from the checkpoint (PAPER: DDPM of SD 2)
PAPER_SCHEDULER = {
    "num_train_timesteps": 1000,
    "timestep_spacing": "leading",
    "steps_offset": 1,
    "clip_sample": False,
    "variance_type": "fixed_small",
    "thresholding": False,
}
# coverage of the 90 % interval on the tune split (docs/method.md)
CALIBRATED = UncertaintyModel(
    near=0.006,
    reach=0.36,
    drift=0.275,
    length=0.024,
    origin=0.7,
    moved=0.72,
    farther=0.193,
    nearer=0.371,
    relief=14.9,
    by_kind=(0.715, 1.02, 1.9, 1.85),
)
# how steering decodes and encodes: by the VAE, `steering_vae`, or a linear map fitted in the run
SteeringCodec = Literal["exact", "tiny", "linear"]
AS_FITTED = Finishing(robust=False, consistent=False, least_share=None)


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Arguments of `SteeredMarigoldPipeline.__call__` that it fills in where none is given.

    num_inference_steps None: as many as the checkpoint says. processing_resolution None: the
    checkpoint's; 0: the image's own size, unless the checkpoint has an image encoder, which only
    knows its training resolution. These fields have no argument of their own:
    scheduler: class name (None: the checkpoint's own) and settings that a local scheduler takes
    instead of the checkpoint's; None leaves the pipeline's scheduler as it is.
    prompt_tokens: length that the empty prompt is padded to, or None for no padding.
    finishing: how the prediction becomes metric.
    """

    num_inference_steps: int | None
    steering_strength: float
    neighborhood_px: int
    anchor_fraction: float
    anchors: Literal["fixed", "redraw"]
    max_anchors: int | None
    condition_alignment: ConditionAlignment
    steering_codec: SteeringCodec
    ensemble_size: int
    mirror: bool
    continuation: bool
    processing_resolution: int | None
    scheduler: tuple[str | None, dict[str, Any]] | None
    prompt_tokens: int | None
    finishing: Finishing

    def override(
        self, *, robust: bool | None = None, consistent: bool | None = None, **arguments: Any
    ) -> "Preset":
        """This preset with the arguments that are not None; the first two are the finishing's."""
        finishing = replace(
            self.finishing,
            robust=self.finishing.robust if robust is None else robust,
            consistent=self.finishing.consistent if consistent is None else consistent,
        )
        changes = {k: v for k, v in arguments.items() if v is not None}
        return replace(self, finishing=finishing, **changes)


PAPER = Preset(
    num_inference_steps=50,
    steering_strength=0.1,
    neighborhood_px=7,
    anchor_fraction=0.05,
    anchors="redraw",
    max_anchors=None,
    condition_alignment="least_squares",
    steering_codec="exact",
    ensemble_size=1,
    mirror=False,
    continuation=False,
    processing_resolution=0,
    scheduler=("DDPMScheduler", PAPER_SCHEDULER),
    prompt_tokens=77,
    finishing=AS_FITTED,
)
# the pipeline as it is: Marigold, unsteered
PLAIN = Preset(
    num_inference_steps=None,
    steering_strength=0.0,
    neighborhood_px=7,
    anchor_fraction=0.05,
    anchors="fixed",
    max_anchors=None,
    condition_alignment="least_squares",
    steering_codec="exact",
    ensemble_size=1,
    mirror=False,
    continuation=False,
    processing_resolution=None,
    scheduler=None,
    prompt_tokens=None,
    finishing=AS_FITTED,
)
# Unsteered: next to the consistency solve, steering made the erased area worse on the embedded
# checkpoint (docs/method.md has the figures). steering_strength turns it on.
DEFAULT = replace(
    PLAIN,
    max_anchors=4000,
    condition_alignment="minmax",
    steering_codec="linear",
    ensemble_size=2,
    mirror=True,
    continuation=True,
    finishing=Finishing(robust=True, consistent=True, least_share=0.02, uncertainty=CALIBRATED),
)
FAST = replace(
    DEFAULT,
    num_inference_steps=1,
    max_anchors=1500,
    ensemble_size=1,
    mirror=False,
    continuation=False,
    scheduler=(None, {"timestep_spacing": "trailing"}),
)
PRESETS = {"paper": PAPER, "default": DEFAULT, "fast": FAST}


def get_preset(name: str | Preset | None) -> Preset:
    """The preset of that name; None is the pipeline as it is. Raises InputError for others."""
    if isinstance(name, Preset):
        return name
    if name is None:
        return PLAIN
    if name not in PRESETS:
        raise InputError(f"unknown preset {name!r}: choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
