"""The one interface of every method in the tables."""

import warnings
from abc import ABC, abstractmethod
from typing import Any, final

import torch

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame, in_words, make_frame
from steered_marigold.errors import NoMeasurementsError

# what answers draw from when nobody gives a generator: the same call gives the same answer
SEED = 0


class DepthCompleter(ABC):
    """Completes the depth of one frame after the other.

    A method sets `name`, which stands in tables and file names, and implements `_complete`.
    steers: whether it moves a diffusion model's predictions while they are denoised.
    answers_without_measurements: whether it can give relative depth from the image alone.
    """

    name: str
    steers: bool = False
    answers_without_measurements: bool = False

    @final
    def complete(
        self,
        image: Any,
        sparse_depth: Any,
        valid_mask: Any = None,
        K: Any = None,
        *,
        confidence: Any = None,
        generator: torch.Generator | None = None,
    ) -> DepthCompletion:
        """Dense metric depth for one image, with a batch axis of 1.

        Arrays may be of NumPy, PyTorch or PIL. image: RGB [height, width, 3], or grey, or with
        alpha; uint8, uint16, or floats in 0..1. sparse_depth: [m], [height, width]; None for
        relative depth from the image alone, where the method can give it. valid_mask: where it was
        measured; None: where it is finite and positive. K: intrinsics [px], for methods that use
        them. confidence: in 0..1, the weight of each measurement, for methods that use it.
        generator: the only source of randomness, a CPU generator; None: one of a fixed seed.

        Raises InputError for arrays that cannot be read so, SizeMismatchError if sizes differ,
        NoMeasurementsError if nothing was measured. Warns where the unit looks wrong.
        """
        frame = make_frame(image, sparse_depth, valid_mask, confidence=confidence, K=K).plausible()
        for notice in frame.notices:
            warnings.warn(notice.text, stacklevel=2)
        return self.answer(frame, generator=generator, relative=sparse_depth is None)

    @final
    def answer(
        self, frame: Frame, *, generator: torch.Generator | None = None, relative: bool = False
    ) -> DepthCompletion:
        """As `complete`, for a frame. relative: relative depth if nothing was measured.

        Raises NoMeasurementsError if nothing was measured, and `relative` is False or not to be had
        from this method.
        """
        if not frame.measured and not (relative and self.answers_without_measurements):
            why = in_words(frame.missing)
            left_out = f" (left out: {why})" if why else ""
            raise NoMeasurementsError(f"{self.name}: nothing was measured{left_out}")
        return self._complete(frame, generator or torch.Generator().manual_seed(SEED))

    @abstractmethod
    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        """The answer to a frame, in which something was measured."""

    def describe(self) -> dict[str, Any]:
        """What runs, as values that JSON holds, for records and tables."""
        return {"method": self.name, "steers": self.steers}
