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
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import LEAST_NOISE, SensorNoise
from steered_marigold.core.frame import Frame
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
# much of one answer's variance. Less is steadier, and holds longer on to what was known worse:
# benchmarks/streams.py
LEAST_SHARE_OF_VARIANCE = 0.5


@dataclass(frozen=True, kw_only=True)
class Recalled:
    """A frame with measurements of earlier ones in its holes.

    remembered: where frame.valid_mask is True through memory alone; frame.confidence, which
    divides the noise's variance, is lower there.
    """

    frame: Frame
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

    def recall(self, frame: Frame, warp: Warp | None) -> Recalled:
        """The frame with remembered measurements in its holes.

        Its own measurements are kept as they are, with their confidence.
        """
        past = _moved(self._measured, warp, frame.image)
        least = self._variance(frame.sparse_depth)
        present = _Known(frame.sparse_depth, least, frame.valid_mask, frame.image.float())
        if past is None:
            self._measured = present
            return Recalled(frame=frame, remembered=torch.zeros_like(frame.valid_mask))
        variance = past.variance + DISAGREEMENT_SHARE * _disagreement(past, present)
        remembered = past.mask & ~frame.valid_mask & (variance < FORGET_NOISE**2)
        depth = torch.where(remembered, past.depth, frame.sparse_depth)
        self._measured = _Known(
            depth,
            torch.where(remembered, variance, least),
            frame.valid_mask | remembered,
            frame.image.float(),
        )
        own = torch.ones_like(depth) if frame.confidence is None else frame.confidence
        weaker = (self._variance(depth) / variance).clamp(max=1.0)
        filled = replace(
            frame,
            sparse_depth=depth,
            valid_mask=frame.valid_mask | remembered,
            confidence=torch.where(remembered, weaker, own),
        )
        return Recalled(frame=filled, remembered=remembered)

    def _variance(self, depth: Tensor) -> Tensor:
        """Of the log of a measurement made now."""
        return self._noise.relative(depth.clamp(min=1e-6)).clamp(min=LEAST_NOISE) ** 2

    def settle(
        self, frame: Frame, completion: DepthCompletion, warp: Warp | None
    ) -> DepthCompletion:
        """The completion of the frame, averaged with the last answer where nothing was known.

        frame: as `recall` gave it. The weights are those of the variances, the present one from
        `uncertainty`, which is left as it is; without it the completion is returned unchanged.
        """
        if completion.uncertainty is None or not completion.metric:
            self._answer = None
            return completion
        depth = completion.depth[0]
        variance = (completion.uncertainty[0] / depth) ** 2
        past = _moved(self._answer, warp, frame.image)
        if past is not None:
            step = torch.where(past.mask, (past.depth / depth).clamp(min=1e-6).log(), 0.0)
            alike = past.mask & ~frame.valid_mask & (step.abs() < OTHER_DEPTH)
            gain = torch.where(alike, variance / (variance + past.variance), 0.0)
            depth = depth * torch.exp(gain * step)
            variance = torch.maximum((1 - gain) * variance, LEAST_SHARE_OF_VARIANCE * variance)
        everywhere = torch.ones_like(frame.valid_mask)
        self._answer = _Known(depth, variance, everywhere, frame.image.float())
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
    length, half = DISAGREEMENT_WINDOW, DISAGREEMENT_WINDOW // 2
    sums = torch.stack((squared * both, both.float()))[:, None]
    for window, padding in (((length, 1), (half, 0)), ((1, length), (0, half))):
        sums = F.avg_pool2d(sums, window, stride=1, padding=padding)  # down, then along rows
    return sums[0, 0] / sums[1, 0].clamp(min=1e-6)
