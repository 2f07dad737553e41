"""Which pairs train, and how often."""

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from training.rgbd import KINDS, Pair, chances, held_out_pairs, read_index, training_pairs


def test_each_kind_is_in_both_splits_and_no_pair_in_two() -> None:
    pairs = {s: {k: held_out_pairs(s, k) for k in KINDS} for s in ("tune", "report")}
    assert all(found for split in pairs.values() for found in split.values())
    everything = [name for split in pairs.values() for found in split.values() for name in found]
    assert len(everything) == len(set(everything))


def test_no_scene_is_trained_and_held_out(rgbd: Path) -> None:
    scenes = {pair.name: pair.scene for pair in read_index(rgbd)}
    held_out = {
        scenes[name]
        for s in ("tune", "report")
        for kind in KINDS
        for name in held_out_pairs(s, kind)
    }
    training = training_pairs(rgbd)
    assert len(training) > 300
    assert not held_out & {pair.scene for pair in training}


def test_a_long_drive_is_not_drawn_by_its_length() -> None:
    pairs = [Pair(f"drive/{i}", "drive") for i in range(100)] + [Pair("desk/0", "desk")]
    drawn: defaultdict[str, float] = defaultdict(float)
    for pair, chance in zip(pairs, chances(pairs), strict=True):
        drawn[pair.scene] += chance
    assert drawn["drive"] / drawn["desk"] == pytest.approx(10)
    assert np.isclose(sum(drawn.values()), 1)
