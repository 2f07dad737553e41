"""The held-out frames stay held out."""

from itertools import pairwise
from pathlib import Path

from training.data import GAP, read_split, training_indices


def test_splits_are_48_and_47_different_frames() -> None:
    tune, report = read_split("tune"), read_split("report")
    assert (len(set(tune)), len(set(report))) == (48, 47)
    assert not set(tune) & set(report)


def test_splits_are_contiguous_blocks(nyuv2_train: Path) -> None:
    frames = sorted(int(path.stem) for path in (nyuv2_train / "depth").glob("*.png"))
    for split in (read_split("tune"), read_split("report")):
        position = [frames.index(i) for i in split]
        blocks = 1 + sum(b != a + 1 for a, b in pairwise(position))
        assert blocks == 6


def test_no_training_frame_is_near_a_held_out_frame(nyuv2_train: Path) -> None:
    held_out = read_split("tune") + read_split("report")
    training = training_indices(nyuv2_train)
    assert len(training) == 680
    assert all(abs(i - j) > GAP for i in training for j in held_out)
