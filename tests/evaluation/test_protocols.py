import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from steered_marigold.core.frame import Frame
from steered_marigold.core.geometry import project, unproject
from steered_marigold.core.sparsity import HALVES
from steered_marigold.datasets.folder import FrameFolder
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import FileFormatError, InputError, SizeMismatchError
from steered_marigold.evaluation.protocols import (
    KINDS,
    WRONG_M,
    PreparedFrame,
    Protocol,
    frame_generator,
    prepare,
)

DIGESTS = {
    "paper-uniform": "6ba206d71440",
    "paper-erased": "0ed5dd526b6a",
    "range": "aa9d1e1981ed",
    "lidar": "98ae3ebc063b",
    "objects": "c07eb345d9bd",
    "region": "1b3988a4d41a",
    "given": "cadc2bfcc58f",
}


def sample(frame_id: str = "0042", size: tuple[int, int] = (480, 640)) -> Sample:
    """A frame with 10 % of its truth missing and a sparse depth of its own."""
    generator = torch.Generator().manual_seed(3)
    depth = 0.5 + 6 * torch.rand(size, generator=generator)
    valid = torch.rand(size, generator=generator) < 0.9
    image = torch.randint(0, 256, (*size, 3), generator=generator, dtype=torch.uint8)
    sparse = torch.rand(size, generator=generator) < 0.02
    frame = Frame(
        id=frame_id,
        image=image,
        sparse_depth=torch.where(sparse, depth, 0.0),
        valid_mask=sparse,
        K=torch.tensor([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    )
    return Sample(frame=frame, metric_depth=torch.where(valid, depth, 0.0), metric_mask=valid)


@pytest.fixture(scope="module")
def masks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two depth maps of 24x32 px, one valid on the left, one on the right."""
    folder = tmp_path_factory.mktemp("masks")
    for name, columns in (("left", slice(0, 16)), ("right", slice(16, 32))):
        depth = np.zeros((24, 32), np.float32)
        depth[:, columns] = 2
        np.save(folder / f"{name}.npy", depth)
    return folder


def protocol(kind: str, masks: Path, **options: Any) -> Protocol:
    return Protocol(kind=kind, masks=masks if kind == "sensor" else None, **options)


def seen(frame: PreparedFrame) -> torch.Tensor:
    return frame.shown.valid_mask


@pytest.mark.parametrize("kind", KINDS)
def test_depends_on_seed_and_frame_alone(kind: str, masks: Path) -> None:
    chosen = protocol(kind, masks, noise=0.1, outliers=0.1)
    first = prepare(sample("a"), chosen, seed=1)
    prepare(sample("b"), chosen, seed=2)
    torch.manual_seed(99)
    again = prepare(sample("a"), chosen, seed=1)
    assert torch.equal(first.shown.sparse_depth, again.shown.sparse_depth)
    for other in (prepare(sample("b"), chosen, seed=1), prepare(sample("a"), chosen, seed=2)):
        assert not torch.equal(first.shown.sparse_depth, other.shown.sparse_depth)


@pytest.mark.parametrize("kind", KINDS)
def test_measurements_are_true_and_areas_hold_truth(kind: str, masks: Path) -> None:
    whole = sample()
    frame = prepare(whole, protocol(kind, masks), seed=0)
    assert tuple(frame.areas) == protocol(kind, masks).areas
    assert 0 < int(seen(frame).sum()) < seen(frame).numel()
    truth = frame.metric_depth if kind != "given" else whole.frame.sparse_depth
    assert torch.equal(frame.shown.sparse_depth[seen(frame)], truth[seen(frame)])
    for mask in frame.areas.values():
        assert bool((frame.metric_depth[mask] > 0).all())


def test_paper_crop_samples_and_areas() -> None:
    whole = sample()
    frame = prepare(whole, Protocol(kind="paper-uniform"), seed=0)
    assert frame.metric_depth.shape == (448, 608)
    assert torch.equal(frame.shown.image, whole.frame.image[16:464, 16:624])
    assert int(seen(frame).sum()) == 13619
    valid = whole.metric_mask[16:464, 16:624]
    # margins: (448 - 248) / 2 = 100, (448 - 198) / 2 = 125, and the same in width
    assert torch.equal(frame.areas["608x448"], valid)
    for area, margin in (("408x248", 100), ("358x198", 125)):
        inside = valid[margin:-margin, margin:-margin]
        assert int(frame.areas[area].sum()) == int(inside.sum())
        assert torch.equal(frame.areas[area][margin:-margin, margin:-margin], inside)


def test_crop_keeps_pixels_on_their_rays() -> None:
    whole = sample()
    frame = prepare(whole, Protocol(kind="paper-uniform"), seed=0)
    assert whole.frame.K is not None
    assert frame.shown.K is not None
    point = unproject(whole.metric_depth, whole.frame.K)[100, 200]
    assert project(point, frame.shown.K).tolist() == pytest.approx([200 - 16, 100 - 16], abs=1e-3)


def test_erased_is_uniform_without_the_centre() -> None:
    uniform = seen(prepare(sample(), Protocol(kind="paper-uniform"), seed=0))
    erased = seen(prepare(sample(), Protocol(kind="paper-erased"), seed=0))
    expected = uniform.clone()
    expected[100:348, 100:508] = False
    assert torch.equal(erased, expected)


def test_fewer_points_are_a_part_of_more() -> None:
    few = seen(prepare(sample(), Protocol(kind="paper-uniform", points=500), seed=0))
    many = seen(prepare(sample(), Protocol(kind="paper-uniform", points=2000), seed=0))
    assert int(few.sum()) == 500
    assert bool(many[few].all())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("paper-")])
def test_open_areas_split_the_truth(kind: str, masks: Path) -> None:
    frame = prepare(sample(), protocol(kind, masks), seed=0)
    full, measured, hidden = frame.areas.values()
    assert torch.equal(full, sample().metric_mask)
    assert torch.equal(full, measured | hidden)
    assert not bool((measured & hidden).any())
    assert torch.equal(measured, full & seen(frame))


def test_range_and_lines() -> None:
    near = prepare(sample(), Protocol(kind="range", max_range=2.0), seed=0)
    assert float(near.shown.sparse_depth.max()) <= 2
    assert float(near.metric_depth[near.areas["hidden"]].min()) > 2
    lidar = prepare(sample(), Protocol(kind="lidar", lines=16), seed=0)
    assert int(seen(lidar).any(dim=1).sum()) == 16


@pytest.mark.parametrize("keep", HALVES)
def test_half_keeps_one_half(keep: str) -> None:
    frame = prepare(sample(), Protocol(kind="half", keep=keep), seed=0)
    kept, hidden = frame.areas["measured"], frame.areas["hidden"]
    assert int(kept.sum()) == pytest.approx(int(hidden.sum()), rel=0.01)
    depth = frame.metric_depth
    if keep == "near":
        assert float(depth[kept].max()) <= float(depth[hidden].min())
    elif keep == "far":
        assert float(depth[kept].min()) >= float(depth[hidden].max())
    elif keep == "bottom":
        assert not bool(kept[:240].any())
    else:
        assert not bool(kept[:, 320:].any())


def test_shape_is_a_square_inside_the_image() -> None:
    whole = replace(sample(), metric_mask=torch.ones(480, 640, dtype=torch.bool))
    frame = prepare(whole, Protocol(kind="shape"), seed=0)
    rows, columns = (~seen(frame)).nonzero(as_tuple=True)
    assert len(rows) == 150 * 150
    assert int(rows.max() - rows.min()) == int(columns.max() - columns.min()) == 149


def test_spoilers_say_what_they_made_wrong() -> None:
    assert prepare(sample(), Protocol(kind="dense", noise=0.1), seed=0).wrong is None
    clean = prepare(room(), Protocol(kind="dense"), seed=0).shown.sparse_depth
    for options in ({"flying_pixels": 1.0}, {"patches": 5}, {"outliers": 0.1}):
        frame = prepare(room(), Protocol(kind="dense", **options), seed=0)
        moved = (frame.shown.sparse_depth - clean).abs() > WRONG_M
        assert frame.wrong is not None
        assert torch.equal(frame.wrong, moved)
        assert bool(moved.any())


def test_flying_pixels_lie_between_both_sides_of_an_edge() -> None:
    frame = prepare(room(), Protocol(kind="dense", flying_pixels=1.0), seed=0)
    assert frame.wrong is not None
    flying = frame.shown.sparse_depth[frame.wrong]
    assert float(flying.min()) > 1.0
    assert float(flying.max()) < 3.0
    columns = frame.wrong.any(dim=0).nonzero()[:, 0]
    assert columns.tolist() == [318, 319, 320, 321]
    some = prepare(room(), Protocol(kind="dense", flying_pixels=0.25), seed=0).wrong
    assert some is not None
    assert int(some.sum()) == pytest.approx(0.25 * int(frame.wrong.sum()), rel=0.2)
    assert not bool((some & ~frame.wrong).any())


def test_patches_are_connected_regions_of_50_to_2000_px() -> None:
    frame = prepare(room(), Protocol(kind="dense", patches=1), seed=0)
    assert frame.wrong is not None
    _, count = ndimage.label(frame.wrong.numpy())
    assert count == 1
    assert 20 < int(frame.wrong.sum()) <= 2100
    factor = frame.shown.sparse_depth[frame.wrong] / frame.metric_depth[frame.wrong]
    assert bool(((factor > 1.25) | (factor < 0.8)).all())


def room() -> Sample:
    """A wall at 1 m on the left, one at 3 m on the right."""
    depth = torch.full((480, 640), 3.0)
    depth[:, :320] = 1.0
    return replace(sample(), metric_depth=depth, metric_mask=torch.ones(480, 640, dtype=torch.bool))


def test_samples_are_those_of_earlier_runs(masks: Path) -> None:
    """Measurements to the bit, so that kept runs and published figures stay comparable."""
    digests = {}
    for kind in DIGESTS:
        chosen = protocol(kind, masks, noise=0.1, outliers=0.1)
        depth = prepare(sample(), chosen, seed=5).shown.sparse_depth
        digests[kind] = hashlib.sha256(depth.contiguous().numpy().tobytes()).hexdigest()[:12]
    assert digests == DIGESTS


def test_region_hides_a_third_of_the_connected_area(real_frames: Path) -> None:
    data = FrameFolder(real_frames, max_depth=20.0)
    for frame_id in ("realsense_3", "window_420"):
        frame = prepare(data.load(frame_id), Protocol(kind="region"), seed=0)
        hidden, full = frame.areas["hidden"], frame.areas["full"]
        assert frame.focus == "hidden"
        assert float(hidden.sum() / full.sum()) == pytest.approx(1 / 3, abs=0.01)


def test_known_area_is_what_was_measured_or_all_outside_the_centre() -> None:
    erased = prepare(sample(), Protocol(kind="paper-erased"), seed=0)
    assert erased.known_area is not None
    assert bool(erased.known_area[~erased.areas["408x248"] & (erased.metric_depth > 0)].all())
    assert int((~erased.known_area).sum()) == 408 * 248
    for kind in ("range", "objects", "region"):
        frame = prepare(sample(), Protocol(kind=kind), seed=0)
        assert frame.known_area is not None
        assert torch.equal(frame.known_area, seen(frame))
    for kind in ("paper-uniform", "lidar", "given"):
        assert prepare(sample(), Protocol(kind=kind), seed=0).known_area is None


def test_sensor_holes_are_those_of_a_depth_map(masks: Path) -> None:
    halves = set()
    for frame_id in map(str, range(12)):
        frame = prepare(sample(frame_id), Protocol(kind="sensor", masks=masks), seed=0)
        left, right = seen(frame)[:, :320], seen(frame)[:, 320:]
        assert bool(left.any()) != bool(right.any())
        halves.add("left" if left.any() else "right")
        valid = sample().metric_mask
        assert torch.equal(left, valid[:, :320]) or torch.equal(right, valid[:, 320:])
    assert halves == {"left", "right"}


def test_sensor_reads_the_layout_of_real_frames(real_frames: Path) -> None:
    frame = prepare(sample(), Protocol(kind="sensor", masks=real_frames), seed=0)
    assert 0 < int(seen(frame).sum()) < int(sample().metric_mask.sum())


def test_noise_and_outliers_leave_the_positions() -> None:
    clean = prepare(sample(), Protocol(kind="paper-uniform"), seed=0)
    noisy = prepare(sample(), Protocol(kind="paper-uniform", noise=0.05), seed=0)
    wrong = prepare(sample(), Protocol(kind="paper-uniform", outliers=0.1), seed=0)
    assert torch.equal(seen(clean), seen(noisy))
    assert torch.equal(seen(clean), seen(wrong))
    changed = clean.shown.sparse_depth != wrong.shown.sparse_depth
    assert int(changed.sum()) == round(0.1 * 13619)


@given(st.integers(0, 2**40), st.text(max_size=8), st.sampled_from(["samples", "method"]))
def test_generators_repeat(seed: int, frame_id: str, purpose: str) -> None:
    draw, again = (
        torch.rand(4, generator=frame_generator(seed, frame_id, purpose)) for _ in range(2)
    )
    assert torch.equal(draw, again)
    other = torch.rand(4, generator=frame_generator(seed + 1, frame_id, purpose))
    assert not torch.equal(draw, other)


def test_names_tell_protocols_apart() -> None:
    assert Protocol(kind="paper-erased").name == "paper-erased"
    assert Protocol(kind="paper-uniform", points=500).name == "paper-uniform-500"
    assert Protocol(kind="range", max_range=2.5).name == "range-2.5"
    assert Protocol(kind="lidar", lines=8, noise=0.1, outliers=0.05).name == (
        "lidar-8+noise-0.1+outliers-0.05"
    )
    assert Protocol(kind="half", keep="far", patches=3).name == "half-far+patches-3"


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(SizeMismatchError, match=r"608x448 px .* 320x240 px"):
        prepare(sample(size=(240, 320)), Protocol(kind="paper-erased"), seed=0)
    unmeasured = replace(sample(), frame=sample().frame.keep(torch.zeros(480, 640) > 0))
    with pytest.raises(InputError, match="no sparse depth"):
        prepare(unmeasured, Protocol(kind="given"), seed=0)
    with pytest.raises(FileFormatError, match="holds no depth maps"):
        prepare(sample(), Protocol(kind="sensor", masks=tmp_path), seed=0)
    with pytest.raises(InputError, match="'random' is not known"):
        Protocol(kind="random")
    with pytest.raises(InputError, match="range does not read points"):
        Protocol(kind="range", points=500)
    with pytest.raises(InputError, match="lines must be positive"):
        Protocol(kind="lidar", lines=0)
    with pytest.raises(InputError, match="sensor needs masks"):
        Protocol(kind="sensor")
    with pytest.raises(InputError, match="outliers"):
        Protocol(kind="lidar", outliers=2.0)
    with pytest.raises(InputError, match="choose one of near, far"):
        Protocol(kind="half", keep="top")
    with pytest.raises(InputError, match="no room for a square"):
        prepare(sample(size=(150, 640)), Protocol(kind="shape"), seed=0)
