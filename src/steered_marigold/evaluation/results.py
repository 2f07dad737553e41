"""What a run records of each completed image, on disk as soon as it is known."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from jaxtyping import Bool
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.metrics import (
    depth_errors,
    seam_step,
    uncertainty_curves,
    uncertainty_errors,
)
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.evaluation.protocols import PreparedFrame
from steered_marigold.io.json_lines import JsonLines


@dataclass(frozen=True, kw_only=True)
class ImageResult:
    """One method on one image.

    areas: by area, `valid_pixels`, the fields of DepthErrors and, if the method states its
        uncertainty, those of UncertaintyErrors. Areas without pixels are left out.
    seconds: time of `complete` alone. trusted_fraction: share of the measurements that the method
        believed. wrong_left_out, right_left_out: shares of the measurements that a spoiler made
        wrong, and of the others, that were not believed; None of none. floored_fraction: share of
        the pixels that were raised to the method's minimum.
    max_deviation_m: largest change of a believed measurement [m]; None if none was.
    seam_step: see `core.metrics.seam_step`; None without a border. curves: the fields of
        UncertaintyCurves in the protocol's focus area, if the method states its uncertainty.
    error: why there is no answer; all else is then empty.
    """

    method: str
    frame_id: str
    areas: Mapping[str, Mapping[str, int | float]]
    seconds: float | None = None
    trusted_fraction: float | None = None
    wrong_left_out: float | None = None
    right_left_out: float | None = None
    floored_fraction: float | None = None
    max_deviation_m: float | None = None
    seam_step: float | None = None
    curves: Mapping[str, Sequence[float]] | None = None
    error: str | None = None


def score(
    completion: DepthCompletion,
    frame: PreparedFrame,
    *,
    method: str,
    seconds: float,
    official: bool = False,
) -> ImageResult:
    """The errors of a completion in each area of the frame.

    Raises InputError if the answer is not metric or not finite in a scored pixel.
    """
    if not completion.metric:
        raise InputError(f"{method} gave relative depth, which has no error in metres")
    depth = completion.depth[0].cpu()
    areas: dict[str, dict[str, int | float]] = {}
    for name, mask in frame.areas.items():
        if not mask.any():
            continue
        errors = asdict(depth_errors(depth, frame.metric_depth, mask, official=official))
        if completion.uncertainty is not None:
            sigma = completion.uncertainty[0].cpu()
            errors |= asdict(uncertainty_errors(depth, sigma, frame.metric_depth, mask))
        areas[name] = {"valid_pixels": int(mask.sum()), **errors}
    whole, known = next(iter(frame.areas.values())), frame.known_area
    measured, trusted = completion.measured[0].cpu(), completion.trusted[0].cpu()
    wrong = torch.zeros_like(measured) if frame.wrong is None else frame.wrong
    floored = completion.floored
    deviation = (depth - frame.shown.sparse_depth)[trusted & measured].abs()
    return ImageResult(
        method=method,
        frame_id=frame.shown.id,
        areas=areas,
        seconds=seconds,
        trusted_fraction=int((trusted & measured).sum()) / max(int(measured.sum()), 1),
        wrong_left_out=_share(~trusted, measured & wrong),
        right_left_out=_share(~trusted, measured & ~wrong),
        floored_fraction=None if floored is None else float(floored.float().mean()),
        max_deviation_m=float(deviation.max()) if deviation.numel() else None,
        seam_step=None if known is None else seam_step(depth, frame.metric_depth, whole, known),
        curves=_curves(completion, frame),
    )


def _share(part: Bool[Tensor, "height width"], whole: Bool[Tensor, "height width"]) -> float | None:
    """How much of the whole is in the part; None if the whole is empty."""
    return float((part & whole).sum() / whole.sum()) if bool(whole.any()) else None


def _curves(
    completion: DepthCompletion, frame: PreparedFrame
) -> Mapping[str, Sequence[float]] | None:
    """Of the stated uncertainty, if there is one, in the focus area, if it has pixels."""
    mask = frame.areas[frame.focus]
    if completion.uncertainty is None or not mask.any():
        return None
    depth, sigma = completion.depth[0].cpu(), completion.uncertainty[0].cpu()
    return asdict(uncertainty_curves(depth, sigma, frame.metric_depth, mask))


class ResultLog:
    """A file of one result a line; see `JsonLines`."""

    def __init__(self, path: Path) -> None:
        self.path, self._lines = path, JsonLines(path)

    def read(self) -> dict[tuple[str, str], ImageResult]:
        """Results by method and frame id, the last one where there are several."""
        try:
            results = [ImageResult(**values) for values in self._lines.read()]
        except TypeError as error:
            raise FileFormatError(
                f"{self.path}: is not a log of results ({error}); run again with `overwrite`"
            ) from error
        return {(result.method, result.frame_id): result for result in results}

    def append(self, result: ImageResult) -> None:
        """Adds a result; returns when it is on disk."""
        self._lines.append(asdict(result))
