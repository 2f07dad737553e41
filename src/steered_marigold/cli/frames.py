"""One frame from files to files: read, complete, write, and the record of what happened."""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.cli.messages import say_warning
from steered_marigold.cli.settings import Inputs, Outputs, Settings
from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.doubts import scale_doubts
from steered_marigold.core.registration import register_depth
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from steered_marigold.io.confidence_maps import read_confidence
from steered_marigold.io.depth_encodings import MILLIMETRE
from steered_marigold.io.depth_maps import (
    read_depth,
    write_depth,
    write_saturating,
)
from steered_marigold.io.images import read_image


@runtime_checkable
class Completer(Protocol):
    """A DepthCompleter that weighs confidence, answers without measurements, and says what ran."""

    @property
    def checkpoint(self) -> str: ...
    @property
    def preset(self) -> str: ...
    @property
    def num_inference_steps(self) -> int: ...
    @property
    def device(self) -> torch.device: ...
    @property
    def dtype(self) -> torch.dtype: ...

    def complete(
        self,
        image: UInt8[Tensor, "height width 3"],
        sparse_depth: Float[Tensor, "height width"],
        valid_mask: Bool[Tensor, "height width"],
        K: Float[Tensor, "3 3"] | None = None,
        *,
        confidence: Float[Tensor, "height width"] | None = None,
        no_measurements: bool = False,
        generator: torch.Generator | None = None,
    ) -> DepthCompletion: ...


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame in memory, all of the image's size. missing: None without a depth file."""

    image: UInt8[Tensor, "height width 3"]
    depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    confidence: Float[Tensor, "height width"] | None = None
    missing: Mapping[str, int] | None = None


def read_frame(inputs: Inputs, settings: Settings) -> Frame:
    """The frame's files, checked against each other; InputError where they cannot be used."""
    if inputs.depth is None:
        image = read_image(inputs.image).pixels
        nothing = torch.zeros(image.shape[:2])
        return Frame(image=image, depth=nothing, valid_mask=nothing > 0)

    measured = read_depth(
        inputs.depth, depth_scale=settings.depth_scale, max_depth=settings.max_depth
    )
    if not measured.valid_mask.any() and not settings.no_measurements:
        raise NoMeasurementsError(
            f"{inputs.depth}: no valid pixel ({_reasons(measured.missing)}); "
            "--no-measurements gives relative depth from the image alone"
        )
    for doubt in scale_doubts(measured.depth, measured.valid_mask):
        say_warning(f"{inputs.depth}: {doubt.text}".replace("`depth_scale`", "--depth-scale"))

    confidence = (
        None if inputs.confidence is None else read_confidence(inputs.confidence).confidence
    )
    if confidence is not None and confidence.shape != measured.depth.shape:
        raise SizeMismatchError(
            f"{inputs.confidence} is {_size(confidence)} but {inputs.depth} {_size(measured.depth)}"
        )
    image = read_image(inputs.image).pixels
    depth, valid_mask = measured.depth, measured.valid_mask
    if settings.registered:
        moved = register_depth(depth, valid_mask, (image.shape[0], image.shape[1]))
        depth, valid_mask = moved.depth, moved.valid_mask
        confidence = None if confidence is None else moved.carry(confidence)
    elif image.shape[:2] != depth.shape:
        raise _other_size(inputs, image[..., 0], depth)
    return Frame(
        image=image,
        depth=depth,
        valid_mask=valid_mask,
        confidence=confidence,
        missing=measured.missing,
    )


def complete_frame(
    completer: Completer, frame: Frame, inputs: Inputs, outputs: Outputs, settings: Settings
) -> dict[str, Any]:
    """Completes the frame, writes what was asked for, returns the record for `--json`."""
    metric = bool(frame.valid_mask.any())
    if not metric and (outputs.point_cloud is not None or settings.max_uncertainty is not None):
        raise InputError(
            f"{inputs.image}: without measurements the depth is relative, so there are no metres "
            "for --point-cloud or --max-uncertainty"
        )
    started = perf_counter()
    completion = completer.complete(
        frame.image,
        frame.depth,
        frame.valid_mask,
        settings.K,
        confidence=frame.confidence,
        no_measurements=not metric,
        generator=torch.Generator().manual_seed(settings.seed),
    )
    depth = completion.depth[0].cpu()  # waits for the device
    seconds = perf_counter() - started

    uncertainty = None if completion.uncertainty is None else completion.uncertainty[0].cpu()
    if uncertainty is None and (outputs.uncertainty or settings.max_uncertainty is not None):
        raise InputError("this run estimates no uncertainty; ask for one with --ensemble 4")
    too_uncertain = torch.zeros_like(frame.valid_mask)
    if uncertainty is not None and settings.max_uncertainty is not None:
        too_uncertain = uncertainty > settings.max_uncertainty
        depth = torch.where(too_uncertain, 0.0, depth)

    written = _write(frame, completion, depth, uncertainty, outputs, settings)
    if completion.slope_rejected is not None and completion.slope_rejected.any():
        say_warning(
            f"{inputs.image}: the measurements contradict the depth seen in the image; "
            "the scale is a ratio of means"
        )
    known = depth[~too_uncertain]
    return {
        "image": str(inputs.image),
        "depth": None if inputs.depth is None else str(inputs.depth),
        "output": str(outputs.depth),
        **{name: str(path) for name, path in outputs.asked().items() if name != "depth"},
        "checkpoint": completer.checkpoint,
        "preset": completer.preset,
        "steps": completer.num_inference_steps,
        "exact_codec_steps": completion.exact_codec_steps,
        "linear_codec_steps": completion.linear_codec_steps,
        "seed": settings.seed,
        "device": str(completer.device),
        "dtype": str(completer.dtype).removeprefix("torch."),
        "seconds": round(seconds, 4),
        "metric": completion.metric,
        "scale": None if completion.scale is None else float(completion.scale[0]),
        "shift": None if completion.shift is None else float(completion.shift[0]),
        "depth_min_m": float(known.min()) if completion.metric and len(known) else None,
        "depth_max_m": float(known.max()) if completion.metric and len(known) else None,
        "input_valid_fraction": float(frame.valid_mask.float().mean()),
        "trusted": int(completion.trusted.sum()),
        "untrusted": int((completion.measured & ~completion.trusted).sum()),
        "floored": 0 if completion.floored is None else int(completion.floored.sum()),
        "too_uncertain": int(too_uncertain.sum()),
        **written,
        "treated_as_missing": None if frame.missing is None else dict(frame.missing),
    }


def _write(
    frame: Frame,
    completion: DepthCompletion,
    depth: Float[Tensor, "height width"],
    uncertainty: Float[Tensor, "height width"] | None,
    outputs: Outputs,
    settings: Settings,
) -> dict[str, int]:
    """Writes all outputs; how many depths did not fit, and how many points were written."""
    unrepresentable, points = 0, 0
    if completion.metric:
        output_scale = settings.output_scale or MILLIMETRE
        unrepresentable = write_depth(outputs.depth, depth, output_scale=output_scale)
    else:
        output_scale = 1 / 65535
        write_saturating(outputs.depth, depth, output_scale=output_scale)
    if unrepresentable:
        say_warning(
            f"{outputs.depth}: {unrepresentable} depths do not fit 16 bits of "
            f"{output_scale} m and were written as 0; .npy, .tiff and .exr hold them, "
            "or another --output-scale"
        )
    if outputs.uncertainty is not None and uncertainty is not None:
        write_saturating(outputs.uncertainty, uncertainty, output_scale=output_scale)
    if outputs.point_cloud is not None and settings.K is not None:
        from steered_marigold.io.point_clouds import point_cloud, write_point_cloud

        cloud = point_cloud(depth, frame.image, settings.K)
        write_point_cloud(outputs.point_cloud, cloud)
        points = len(cloud.points)
    if outputs.visualization is not None:
        from steered_marigold.io.visualization import draw_panels

        draw_panels(
            outputs.visualization,
            image=frame.image,
            sparse_depth=frame.depth,
            valid_mask=frame.valid_mask,
            depth=depth,
            uncertainty=uncertainty,
            metric=completion.metric,
        )
    return {"unrepresentable": unrepresentable, "points": points}


def _other_size(inputs: Inputs, image: Tensor, depth: Tensor) -> SizeMismatchError:
    """Names both sizes, and the likeliest way out."""
    advice = "--depth-grid registered takes a depth map of lower resolution and equal view"
    if image.shape == depth.shape[::-1]:
        advice = "one of them is turned by 90 degrees (the image's EXIF orientation was applied)"
    return SizeMismatchError(
        f"{inputs.image} is {_size(image)} but {inputs.depth} {_size(depth)}; {advice}"
    )


def _size(array: Tensor) -> str:
    height, width = array.shape
    return f"{width}x{height}"


def _reasons(missing: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in missing.items() if n)
