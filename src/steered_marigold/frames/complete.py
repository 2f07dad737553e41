"""A frame in, its completion and the record of what happened out: what every front end calls."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.core.notices import Notice
from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.methods.completer import SEED, DepthCompleter

# shares of all pixels, and of the measurements, from which a person is told
NOTEWORTHY = 0.01
CONTRADICTORY = 0.1


@dataclass(frozen=True, kw_only=True)
class Record:
    """What happened to a frame.

    values: settings, times, counts, as JSON holds them. notices: what a person should know.
    """

    values: Mapping[str, Any]
    notices: tuple[Notice, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Both, as values that JSON holds."""
        return {**self.values, "notices": [vars(notice) for notice in self.notices]}

    def extended(self, values: Mapping[str, Any], *notices: Notice) -> "Record":
        """With more of both; values of the same name are replaced."""
        return Record(values={**self.values, **values}, notices=(*self.notices, *notices))


def complete_frame(
    completer: DepthCompleter,
    frame: Frame,
    *,
    seed: int = SEED,
    no_measurements: bool = False,
    max_uncertainty: float | None = None,
) -> tuple[DepthCompletion, Record]:
    """Completes a frame on the CPU's side: the answer's tensors have left the device.

    Measurements that can be no depth are left out, see `Frame.plausible`.

    no_measurements: where nothing was measured, give relative depth. max_uncertainty: depth whose
    uncertainty [m] is larger becomes 0, unknown.

    Raises InputError where these cannot be had, NoMeasurementsError where nothing was measured.
    """
    require_max_uncertainty(max_uncertainty)
    if max_uncertainty is not None and not frame.measured:
        raise InputError(
            "without measurements the depth is relative: there are no metres for `max_uncertainty`"
        )
    frame = frame.plausible()
    started = perf_counter()
    completion = completer.answer(
        frame, generator=torch.Generator().manual_seed(seed), relative=no_measurements
    )
    completion = _to_cpu(completion)  # waits for the device
    seconds = perf_counter() - started

    completion, impossible = _without_impossible(completion)
    too_uncertain = torch.zeros_like(frame.valid_mask)
    if max_uncertainty is not None:
        too_uncertain = require_uncertainty(completion) > max_uncertainty
        completion = replace(completion, depth=torch.where(too_uncertain, 0.0, completion.depth))
    known = completion.depth[0][completion.depth[0] > 0]
    bounded = completion.metric and len(known) > 0
    values = {
        "frame": frame.id,
        **completer.describe(),
        "seed": seed,
        "seconds": round(seconds, 4),
        "metric": completion.metric,
        "scale": None if completion.scale is None else float(completion.scale[0]),
        "shift": None if completion.shift is None else float(completion.shift[0]),
        "depth_min_m": float(known.min()) if bounded else None,
        "depth_max_m": float(known.max()) if bounded else None,
        "exact_codec_steps": completion.exact_codec_steps,
        "linear_codec_steps": completion.linear_codec_steps,
        "input_valid_fraction": float(frame.valid_mask.float().mean()),
        "trusted": int(completion.trusted.sum()),
        "untrusted": int((completion.measured & ~completion.trusted).sum()),
        "floored": _count(completion.floored),
        "beyond_range": _count(completion.beyond_range),
        "not_positive": impossible,
        "too_uncertain": int(too_uncertain.sum()),
        "treated_as_missing": dict(frame.missing) or None,
    }
    notices = (*frame.notices, *_doubts(completion), *_of_impossible(impossible))
    return completion, Record(values=values, notices=notices)


def _without_impossible(completion: DepthCompletion) -> tuple[DepthCompletion, int]:
    """Metric depth at or behind the camera becomes 0, unknown; and how many pixels that are.

    Presets that end with the final solve give none; those that follow the paper to the letter can.

    Raises SteeredMarigoldError for depth or uncertainty that is not finite.
    """
    for values in (completion.depth, completion.uncertainty):
        if values is not None and not torch.isfinite(values).all():
            raise SteeredMarigoldError(
                "the model's answer is not finite: `dtype=float32` has the larger range; if that "
                "does not help, the checkpoint is damaged"
            )
    if not completion.metric:
        return completion, 0
    depth = completion.depth.clamp(min=0.0)
    return replace(completion, depth=depth), int((completion.depth <= 0).sum())


def _of_impossible(count: int) -> list[Notice]:
    """What a person should know of depth that is none."""
    text = f"{count} depths came out at or behind the camera and were written as 0, unknown"
    return [Notice("not_positive", text)] if count else []


def require_max_uncertainty(max_uncertainty: float | None) -> None:
    """InputError for a bound [m] that is no positive number."""
    if max_uncertainty is not None and not 0 < max_uncertainty < float("inf"):
        raise InputError(f"`max_uncertainty` must be a positive number, not {max_uncertainty}")


def require_uncertainty(completion: DepthCompletion) -> torch.Tensor:
    """The uncertainty [batch, height, width], or InputError if there is none."""
    if completion.uncertainty is None:
        raise InputError("this run states no uncertainty; `ensemble_size=4` makes it state one")
    return completion.uncertainty


def _doubts(completion: DepthCompletion) -> list[Notice]:
    """What the answer itself says against it."""
    doubts = []
    if completion.slope_rejected is not None and completion.slope_rejected.any():
        text = (
            "the measurements contradict the depth seen in the image; the scale is a ratio of means"
        )
        doubts.append(Notice("slope_rejected", text))
    for kind, mask, what in (
        ("floored", completion.floored, "was raised to the least depth that is believed"),
        ("beyond_range", completion.beyond_range, "lies far outside of what was measured"),
    ):
        share = 0.0 if mask is None else float(mask.float().mean())
        if share > NOTEWORTHY:
            text = (
                f"{share:.0%} of the depth {what}; its uncertainty says how little is known there"
            )
            doubts.append(Notice(kind, text))
    untrusted = completion.measured & ~completion.trusted
    share = float(untrusted.sum()) / max(int(completion.measured.sum()), 1)
    if share > CONTRADICTORY:
        text = f"{share:.0%} of the measurements contradict the others or the image: left out"
        doubts.append(Notice("contradictory", text))
    return doubts


def _count(mask: torch.Tensor | None) -> int:
    return 0 if mask is None else int(mask.sum())


def _to_cpu(completion: DepthCompletion) -> DepthCompletion:
    moved: dict[str, Any] = {k: v.cpu() for k, v in vars(completion).items() if torch.is_tensor(v)}
    return replace(completion, **moved)
