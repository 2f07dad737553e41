"""The streaming completer: what it takes over from one frame to the next, and what it forgets."""

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from steered_marigold.core.interpolation import ScatteredInterpolant
from steered_marigold.errors import InputError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter
from steered_marigold.methods.streaming import StreamingCompleter
from tests.diffusion.conftest import tiny_pipeline

Frame = tuple[Tensor, Tensor, Tensor]


def frame(seed: int, height: int = 48, width: int = 64) -> Frame:
    """(image, depth [m], mask); the mask is the same for every seed."""
    generator = torch.Generator().manual_seed(seed)
    image = torch.randint(256, (height, width, 3), dtype=torch.uint8, generator=generator)
    depth = 1 + torch.rand(height, width, generator=generator)
    mask = torch.rand(height, width, generator=torch.Generator().manual_seed(9)) < 0.1
    return image, depth, mask


def streaming(**arguments: Any) -> StreamingCompleter:
    completer = SteeredCompleter(
        tiny_pipeline(), "tiny", preset="fast", num_inference_steps=4, **arguments
    )
    return StreamingCompleter(completer, restart=0.5)


def count_calls(owner: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A list that grows with each call of a method."""
    calls: list[str] = []
    original: Callable[..., Any] = getattr(owner, name)

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(name)
        return original(*args, **kwargs)

    monkeypatch.setattr(owner, name, counted)
    return calls


def test_later_frames_run_fewer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = streaming()
    calls = count_calls(stream.completer.pipeline.unet, "forward", monkeypatch)
    steps = []
    for seed in range(3):
        calls.clear()
        stream.complete(*frame(seed))
        steps.append(len(calls))
    assert steps == [4, 2, 2]


def test_the_first_frame_is_that_of_the_completer() -> None:
    stream = streaming()
    alone = stream.completer.complete(*frame(0), generator=torch.Generator().manual_seed(0))
    assert torch.equal(stream.complete(*frame(0)).depth, alone.depth)


def test_a_stream_is_a_completer_with_a_name_and_a_generator() -> None:
    stream = streaming()
    assert isinstance(stream, DepthCompleter)
    assert stream.name == "stream:fast"
    assert (stream.steers, streaming(steering_strength=0.3).steers) == (False, True)
    described = stream.describe()
    assert (described["method"], described["restart"], described["steps"]) == (
        "stream:fast",
        0.5,
        4,
    )
    first, other = (torch.Generator().manual_seed(seed) for seed in (0, 1))
    expected = streaming().complete(*frame(0), generator=first).depth
    assert not torch.equal(streaming().complete(*frame(0), generator=other).depth, expected)
    assert torch.equal(stream.complete(*frame(0)).depth, expected)  # seeded where none is given


def test_the_noise_is_that_of_the_first_frame() -> None:
    streams = streaming(), streaming()
    for stream in streams:
        stream.complete(*frame(0), generator=torch.Generator().manual_seed(0))
    answers = [
        stream.complete(*frame(1), generator=torch.Generator().manual_seed(seed)).depth
        for seed, stream in enumerate(streams)
    ]
    assert torch.equal(*answers)


def test_a_single_step_leaves_nothing_of_the_frame_before() -> None:
    completer = SteeredCompleter(tiny_pipeline(), "tiny", preset="fast")
    assert completer.num_inference_steps == 1
    with pytest.raises(InputError, match="at least two steps: `num_inference_steps=2`"):
        StreamingCompleter(completer)


@pytest.mark.parametrize("cut", ["reset", "another size"])
def test_after_a_cut_nothing_is_left_of_earlier_frames(cut: str) -> None:
    fresh, stream = streaming(), streaming()
    if cut == "reset":
        stream.complete(*frame(1))
        stream.reset()
    else:
        stream.complete(*frame(1, height=40))
    assert torch.equal(stream.complete(*frame(0)).depth, fresh.complete(*frame(0)).depth)
    assert not torch.equal(stream.complete(*frame(0)).depth, fresh.complete(*frame(2)).depth)


def test_where_the_same_pixels_are_measured_the_triangulation_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = streaming(steering_strength=0.3)
    stream.complete(*frame(0))
    built = count_calls(ScatteredInterpolant, "__init__", monkeypatch)
    stream.complete(*frame(1))
    assert built == []
    image, depth, mask = frame(2)
    stream.complete(image, depth, mask.roll(1, 0))
    assert built == ["__init__"]
