"""An endless stream of training samples from all sources."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset

from rooms.shards import CROPS, DRAWN, shards_in
from training.data import (
    NYU_BORDER,
    Frame,
    Image,
    augment,
    composite,
    in_colours_of,
    read_nyu_frame,
    sample_of,
    training_indices,
)
from training.rgbd import chances, read_pair, training_pairs

Sample = dict[str, torch.Tensor]
# share of NYUv2's frames that are put together from two
COMPOSITES = 0.3
# how often a sample comes from each source, where all are given
SHARES = {"nyuv2": 0.5, "rgbd": 0.2, "rooms": 0.3}


@dataclass(frozen=True)
class Sources:
    """Where training frames come from.

    nyuv2, rgbd: folders of photographs, or None. rooms: folders of rendered shards.
    """

    nyuv2: Path | None = None
    rgbd: Path | None = None
    rooms: Sequence[Path] = ()

    @property
    def procedural_only(self) -> bool:
        """Whether there is no photograph in it."""
        return self.nyuv2 is None and self.rgbd is None


class MixedFrames(IterableDataset[Sample]):
    """An endless stream of augmented samples.

    shares: the probability of each source, scaled to those that are given.
    """

    def __init__(
        self, sources: Sources, *, seed: int, shares: Mapping[str, float] = SHARES
    ) -> None:
        nyuv2, rgbd = sources.nyuv2, sources.rgbd
        indices = training_indices(nyuv2) if nyuv2 else []
        pairs = training_pairs(rgbd) if rgbd else []
        self.frames = [read_nyu_frame(nyuv2, i) for i in indices] if nyuv2 else []
        self.pairs = [read_pair(rgbd, pair.name) for pair in pairs] if rgbd else []
        self.photographs = [*self.frames, *self.pairs]
        self.chances = chances(pairs)
        self.sources = sources
        found = {"nyuv2": self.frames, "rgbd": self.pairs, "rooms": self._shards()}
        self.shares = {name: shares[name] for name, items in found.items() if items}
        if not self.shares:
            raise FileNotFoundError(f"no training data in {sources}")
        self.seed = seed

    def __iter__(self) -> Iterator[Sample]:
        info = torch.utils.data.get_worker_info()
        rng = np.random.default_rng([self.seed, info.id if info else 0])
        streams = {"nyuv2": self._nyuv2(rng), "rgbd": self._rgbd(rng), "rooms": self._rooms(rng)}
        names = list(self.shares)
        weights = np.array(list(self.shares.values()))
        while True:
            name = names[rng.choice(len(names), p=weights / weights.sum())]
            sample = sample_of(next(streams[name]))
            if sample is not None:
                yield sample

    def _nyuv2(self, rng: np.random.Generator) -> Iterator[Frame]:
        while True:
            for i in rng.permutation(len(self.frames)):
                frame = self.frames[i]
                if rng.random() < COMPOSITES:
                    frame = composite(frame, self.frames[rng.integers(len(self.frames))], rng)
                yield augment(frame, NYU_BORDER, rng)

    def _rgbd(self, rng: np.random.Generator) -> Iterator[Frame]:
        while True:
            yield augment(self.pairs[rng.choice(len(self.pairs), p=self.chances)], 0, rng)

    def _shards(self) -> list[Path]:
        crops = [path for folder in self.sources.rooms for path in shards_in(folder, CROPS)]
        if crops and self.sources.procedural_only:
            raise ValueError(f"{crops[0]} holds textures of photographs; leave its folder out")
        return crops + [path for folder in self.sources.rooms for path in shards_in(folder, DRAWN)]

    def _rooms(self, rng: np.random.Generator) -> Iterator[Frame]:
        while True:
            shards = self._shards()  # more may have been rendered since the last pass
            for i in rng.permutation(len(shards)):
                with np.load(shards[i]) as shard:
                    images, depths = shard["image"], shard["depth"]
                for j in rng.permutation(len(images)):
                    image = self._like_a_photograph(images[j], rng)
                    yield augment(Frame(image, depths[j]), 0, rng)

    def _like_a_photograph(self, image: Image, rng: np.random.Generator) -> Image:
        """Half of the rendered images in the colours of a training photograph, if there is one."""
        if not self.photographs or rng.random() < 0.5:
            return image
        chosen = self.photographs[rng.integers(len(self.photographs))]
        return in_colours_of(chosen.image, image)


def batches(dataset: IterableDataset[Sample], batch_size: int) -> Iterator[Sample]:
    """Endless batches, made in one process beside the training."""
    return iter(DataLoader(dataset, batch_size, num_workers=1, prefetch_factor=4))
