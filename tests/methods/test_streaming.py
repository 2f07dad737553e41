"""The streaming completer: what it takes over from one frame to the next, and what it forgets."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from steered_marigold.core.frame import Frame, make_frame
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.streaming import StreamingCompleter
from tests.diffusion.conftest import tiny_pipeline

K = torch.tensor([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])


def scene(shift: int = 0, *, height: int = 48, width: int = 64) -> Frame:
    """A slanted, textured wall, all of it measured; the camera moves right by pixels at 2 m."""
    generator = torch.Generator().manual_seed(3)
    texture = torch.randint(256, (height, 3 * width, 3), dtype=torch.uint8, generator=generator)
    depth = torch.full((height, width), 2.0)
    pose = torch.eye(4)
    pose[0, 3] = shift * 2.0 / 60
    return make_frame(texture[:, shift : shift + width], depth, K=K, pose=pose, id=str(shift))


def with_hole(frame: Frame) -> Frame:
    hole = torch.zeros_like(frame.valid_mask)
    hole[10:30, 20:44] = True
    return frame.keep(~hole)


def streaming(**arguments: Any) -> StreamingCompleter:
    completer = SteeredCompleter(tiny_pipeline(), "tiny", preset="fast", **arguments)
    return StreamingCompleter(completer)


def test_the_first_frame_is_that_of_the_completer() -> None:
    stream, frame = streaming(), with_hole(scene())
    alone = stream.completer.answer(frame, generator=torch.Generator().manual_seed(0))
    assert torch.equal(stream.answer(frame).depth, alone.depth)


def test_a_stream_is_a_completer_with_a_name_and_a_generator() -> None:
    stream, frame = streaming(), with_hole(scene())
    assert isinstance(stream, DepthCompleter)
    assert stream.name == "stream:fast"
    assert (stream.steers, streaming(steering_strength=0.3).steers) == (False, True)
    described = stream.describe()
    assert (described["method"], described["steps"]) == ("stream:fast", 1)
    first, other = (torch.Generator().manual_seed(seed) for seed in (0, 1))
    expected = streaming().answer(frame, generator=first).depth
    assert not torch.equal(streaming().answer(frame, generator=other).depth, expected)
    assert torch.equal(stream.answer(frame).depth, expected)  # seeded where none is given


def test_the_noise_is_that_of_the_first_frame() -> None:
    streams = streaming(), streaming()
    for stream in streams:
        stream.answer(with_hole(scene()), generator=torch.Generator().manual_seed(0))
    answers = [
        stream.answer(with_hole(scene(1)), generator=torch.Generator().manual_seed(seed)).depth
        for seed, stream in enumerate(streams)
    ]
    assert torch.equal(*answers)


@pytest.mark.parametrize("shift", [0, 6])
def test_what_was_measured_before_fills_the_holes_of_the_present(shift: int) -> None:
    """The camera stands still, or moves with a known pose: the hole was seen a frame ago."""
    alone = streaming().answer(with_hole(scene(shift)))
    stream = streaming()
    stream.answer(scene())
    present = with_hole(scene(shift))
    answer = stream.answer(present)
    hole = ~present.valid_mask
    errors = [float((a.depth[0] - 2.0).abs()[hole].mean()) for a in (alone, answer)]
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 0.02
    assert torch.equal(answer.measured[0], present.valid_mask)
    assert not answer.trusted[0][hole].any()
    kept = answer.trusted[0]
    assert torch.equal(answer.depth[0][kept], present.sparse_depth[kept])


def test_the_image_tells_what_has_changed() -> None:
    """Where other colours are seen nothing is remembered."""
    stream = streaming()
    stream.answer(scene())
    present = with_hole(scene())
    other = replace(present, image=255 - present.image)
    answer, alone = stream.answer(other), streaming().answer(other)
    hole = ~present.valid_mask
    apart = (answer.depth[0] - alone.depth[0]).abs()[hole]
    assert float((apart < 0.02).float().mean()) > 0.9  # greys are nearly their own negatives


@pytest.mark.parametrize("cut", ["reset", "another size"])
def test_after_a_cut_nothing_is_left_of_earlier_frames(cut: str) -> None:
    stream = streaming()
    stream.answer(scene(height=48 if cut == "reset" else 40))
    if cut == "reset":
        stream.reset()
    frame = with_hole(scene())
    assert torch.equal(stream.answer(frame).depth, streaming().answer(frame).depth)
