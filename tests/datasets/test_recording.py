"""A recording as a data set."""

from pathlib import Path

import numpy as np
import pytest

from steered_marigold.datasets.registry import open_dataset
from steered_marigold.errors import FileFormatError
from steered_marigold.evaluation.protocols import Protocol, prepare
from tests.io.bags.building import (
    START,
    Entry,
    bag_path,
    builder_for,
    camera_entries,
    colour,
    depth_mm,
    write_bag,
)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_every_pair_is_a_frame(tmp_path: Path, kind: str) -> None:
    builder = builder_for(kind)
    early = builder.image(depth_mm(9), "16UC1", START - 10**9, "camera")  # has no image
    entries = [
        Entry("/camera/depth/image_raw", START - 10**9, early),
        *camera_entries(builder, count=4),
    ]
    dataset = open_dataset("recording", write_bag(bag_path(tmp_path, kind), kind, entries))
    assert len(dataset.frame_ids) == 4
    assert dataset.frame_ids[0] == str(START + 4_000_000)
    for i, frame_id in enumerate(dataset.frame_ids):
        sample = dataset.load(frame_id)
        assert np.array_equal(sample.frame.image.numpy(), colour(i))
        assert np.allclose(sample.metric_depth.numpy(), depth_mm(i) * 0.001, rtol=1e-6)
        assert np.array_equal(sample.metric_mask.numpy(), depth_mm(i) > 0)
        assert sample.frame.stamp == pytest.approx(int(frame_id) * 1e-9)
    prepared = prepare(sample, Protocol(kind="region"), seed=0)
    assert 0 < int(prepared.shown.valid_mask.sum()) < int(sample.metric_mask.sum())


def test_what_holds_no_pairs(tmp_path: Path) -> None:
    builder = builder_for("ros1")
    lone = [
        Entry("/depth/image_raw", START, builder.image(depth_mm(0), "16UC1", START)),
        Entry("/rgb/image_raw", START, builder.image(colour(0), "rgb8", START + 10**9)),
    ]
    path = write_bag(bag_path(tmp_path, "ros1"), "ros1", lone)
    with pytest.raises(FileFormatError, match="no image and depth within 20 ms"):
        open_dataset("recording", path)
