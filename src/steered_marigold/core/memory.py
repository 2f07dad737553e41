"""What earlier frames of a video know of the present one.

Measurements of earlier frames are moved along and stand in where the present frame measured
nothing, with a noise that grows with their age and with how far what came along disagrees with
what is measured now. The last answer is moved along too, and an answer is averaged with it where
neither frame nor memory measured: a Kalman filter on log depth, a pixel at a time (R. E. Kalman,
"A new approach to linear filtering and prediction problems", 1960).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import LEAST_NOISE, SensorNoise
from steered_marigold.core.registration import Registration

# depth [m] and mask of the earlier frame, as the present one sees them; see core/warping.py
Warp = Callable[[Float[Tensor, "height width"], Bool[Tensor, "height width"]], Registration]

# relative noise that a frame adds: the motion is not exact, nor the nearest pixel the right one
AGE_NOISE = 0.004
# share of the mean squared disagreement around a pixel that is added to its variance
DISAGREEMENT_SHARE = 0.1
DISAGREEMENT_WINDOW = 31
# relative noise at which a measurement is forgotten, and the disagreement counted at most
FORGET_NOISE = 0.05
LARGEST_DISAGREEMENT = 0.1
# mean difference of RGB (of 255) at which a pixel shows something else than the remembered one
OTHER_COLOUR = 30.0
# answers that differ more, in log depth, show different things
OTHER_DEPTH = 0.15
# errors of successive answers are alike: their average is never believed to be better than so
# much of one answer's variance
LEAST_SHARE_OF_VARIANCE = 0.15


@dataclass(frozen=True, kw_only=True)
class Recalled:
    """Measurements of the present frame and those of earlier ones in its holes.

    sparse_depth: [m], 0 where valid_mask is False. confidence: in [0, 1], divides the noise's
    variance; None if nothing is remembered and none was given. remembered: valid only through
    memory.
    """

    sparse_depth: Float[Tensor, "height width"]
    valid_mask: Bool[Tensor, "height width"]
    confidence: Float[Tensor, "height width"] | None
    remembered: Bool[Tensor, "height width"]


@dataclass(frozen=True)
class _Known:
    """depth: [m]; variance: of log depth; both where mask. colour: RGB of the frame."""

    depth: Tensor
    variance: Tensor
    mask: Tensor
    colour: Tensor


class StreamMemory:
    """Of one video: `recall` before a frame is completed, `settle` after it.

    noise: of the sensor. Both take the frame before as seen from the present one; None forgets
    it, as a cut or a frame of another size does.
    """

    def __init__(self, noise: SensorNoise | None = None) -> None:
        self._noise = noise or SensorNoise()
        self._measured: _Known | None = None
        self._answer: _Known | None = None

    def reset(self) -> None:
        """The next frame starts anew."""
        self._measured = self._answer = None

    def recall(
        self,
        image: UInt8[Tensor, "height width 3"],
        sparse_depth: Float[Tensor, "height width"],
        valid_mask: Bool[Tensor, "height width"],
        warp: Warp | None,
        *,
        confidence: Float[Tensor, "height width"] | None = None,
    ) -> Recalled:
        """The frame's measurements [m] and, in its holes, remembered ones.

        Present measurements are kept as they are, with their confidence.
        """
        least = self._noise.relative(sparse_depth.clamp(min=1e-6)).clamp(min=LEAST_NOISE) ** 2
        present = _Known(sparse_depth, least, valid_mask, image.float())
        past = _moved(self._measured, warp, image)
        if past is None:
            self._measured = present
            nothing = torch.zeros_like(valid_mask)
            return Recalled(
                sparse_depth=sparse_depth,
                valid_mask=valid_mask,
                confidence=confidence,
                remembered=nothing,
            )
        variance = past.variance + DISAGREEMENT_SHARE * _disagreement(past, present)
        remembered = past.mask & ~valid_mask & (variance < FORGET_NOISE**2)
        depth = torch.where(remembered, past.depth, sparse_depth)
        self._measured = _Known(
            depth, torch.where(valid_mask, least, variance), valid_mask | remembered, image.float()
        )
        expected = self._noise.relative(depth.clamp(min=1e-6)).clamp(min=LEAST_NOISE) ** 2
        given = torch.ones_like(depth) if confidence is None else confidence
        weaker = torch.where(remembered, expected / variance.clamp(min=1e-12), 0.0)
        return Recalled(
            sparse_depth=depth,
            valid_mask=valid_mask | remembered,
            confidence=torch.where(valid_mask, given, weaker.clamp(max=1.0)),
            remembered=remembered,
        )

    def settle(
        self,
        image: UInt8[Tensor, "height width 3"],
        completion: DepthCompletion,
        known: Bool[Tensor, "height width"],
        warp: Warp | None,
    ) -> DepthCompletion:
        """The completion of one frame, its depth averaged with the last answer's outside `known`.

        The weights are those of their variances, the present one from `uncertainty`, which is
        left as it is; without it the completion is returned unchanged.
        """
        if completion.uncertainty is None or not completion.metric:
            self._answer = None
            return completion
        depth = completion.depth[0]
        variance = (completion.uncertainty[0] / depth) ** 2
        past = _moved(self._answer, warp, image)
        if past is not None:
            step = torch.where(past.mask, (past.depth / depth).clamp(min=1e-6).log(), 0.0)
            alike = past.mask & ~known & (step.abs() < OTHER_DEPTH)
            gain = torch.where(alike, variance / (variance + past.variance), 0.0)
            depth = depth * torch.exp(gain * step)
            variance = torch.maximum((1 - gain) * variance, LEAST_SHARE_OF_VARIANCE * variance)
        everywhere = torch.ones_like(known)
        self._answer = _Known(depth, variance, everywhere, image.float())
        return replace(completion, depth=depth[None])


def _moved(known: _Known | None, warp: Warp | None, image: Tensor) -> _Known | None:
    """The knowledge of the frame before, a frame older, where the image shows the same colours."""
    if known is None or warp is None or known.colour.shape != image.shape:
        return None
    landed = warp(known.depth, known.mask)
    colour = torch.stack([landed.carry(known.colour[..., i]) for i in range(3)], dim=-1)
    same = (colour - image.float()).abs().mean(dim=-1) < OTHER_COLOUR
    variance = landed.carry(known.variance) + AGE_NOISE**2
    return _Known(landed.depth, variance, landed.valid_mask & same, colour)


def _disagreement(past: _Known, present: _Known) -> Float[Tensor, "height width"]:
    """Mean squared difference of log depth around each pixel where both are known; 0 if nowhere."""
    both = past.mask & present.mask
    ratio = torch.where(both, past.depth, 1.0) / torch.where(both, present.depth, 1.0)
    squared = ratio.log().clamp(-LARGEST_DISAGREEMENT, LARGEST_DISAGREEMENT) ** 2
    half = DISAGREEMENT_WINDOW // 2
    sums = F.avg_pool2d(
        torch.stack((squared * both, both.float()))[:, None],
        DISAGREEMENT_WINDOW,
        stride=1,
        padding=half,
    )[:, 0]
    return sums[0] / sums[1].clamp(min=1e-6)
