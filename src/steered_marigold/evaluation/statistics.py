"""How sure a mean over images is, and whether two methods differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from steered_marigold.core.metrics import exact_mean
from steered_marigold.errors import InputError

_RESAMPLES = 5_000
_SEED = 0
_LEAST_IMAGES = 6  # all of fewer have the same sign by chance in more than 1 of 20 cases


@dataclass(frozen=True, kw_only=True)
class PairedDifference:
    """Mean of first - second over the `images` that both have, and its 95 % interval."""

    difference: float
    low: float
    high: float
    images: int

    @property
    def significant(self) -> bool:
        """Whether the interval leaves out 0, of at least 6 images."""
        return self.images >= _LEAST_IMAGES and (self.low > 0 or self.high < 0)


def bootstrap_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % percentile interval of the mean over images (Efron), resampling images.

    The same images give the same interval: the seed is fixed. Raises InputError without images.
    """
    if not values:
        raise InputError("an interval needs at least one image")
    means = (_resamples(len(values)) * np.asarray(values, dtype=np.float64)).mean(axis=1)
    low, high = np.percentile(means, (2.5, 97.5))
    return float(low), float(high)


def paired_comparison(first: Mapping[str, float], second: Mapping[str, float]) -> PairedDifference:
    """The difference of two methods on the same images, by frame id.

    Raises InputError if they share no image.
    """
    shared = sorted(first.keys() & second.keys())
    if not shared:
        raise InputError("two methods can only be compared on images that both completed")
    differences = [first[frame] - second[frame] for frame in shared]
    low, high = bootstrap_interval(differences)
    return PairedDifference(
        difference=exact_mean(differences), low=low, high=high, images=len(shared)
    )


@lru_cache(maxsize=4)
def _resamples(images: int) -> NDArray[np.int64]:
    """How often each image is drawn, [resamples, images]."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(images, np.full(images, 1 / images), size=_RESAMPLES)
