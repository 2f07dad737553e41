"""Whatever numbers go in, finite and positive depth comes out, or one named error."""

import os
from contextlib import suppress
from functools import cache

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import make_frame
from steered_marigold.errors import InputError, SteeredMarigoldError
from steered_marigold.frames.complete import complete_frame
from steered_marigold.methods.steered import SteeredCompleter
from tests.diffusion.conftest import tiny_pipeline

LONG = "FAULTS" in os.environ
PRESETS = ("default", "fast", "paper", "paper-minmax", None)
DTYPES = (torch.float32, torch.bfloat16, torch.float16)


@cache
def _completer(preset: str | None, dtype: torch.dtype = torch.float32) -> SteeredCompleter:
    """A tiny random checkpoint; few steps, for time."""
    pipeline = tiny_pipeline().to(dtype=dtype)
    return SteeredCompleter(pipeline, "tiny", preset=preset, num_inference_steps=2)


def _complete(completer: SteeredCompleter, depth: torch.Tensor) -> DepthCompletion:
    """As the commands do: what is at or behind the camera is 0, unknown."""
    image = torch.randint(0, 256, (*depth.shape, 3), generator=torch.Generator().manual_seed(0))
    frame = make_frame(image.to(torch.uint8), depth)
    answer, record = complete_frame(completer, frame)
    if completer.name in ("default", "fast"):  # they end with the final solve
        assert record.values["not_positive"] == 0
    assert record.values["not_positive"] == int((answer.depth == 0).sum())
    return answer


def _check(answer: DepthCompletion) -> None:
    assert torch.isfinite(answer.depth).all()
    assert (answer.depth >= 0).all()
    if answer.uncertainty is not None:
        assert torch.isfinite(answer.uncertainty).all()
        assert (answer.uncertainty > 0).all()


# every float32 there is: denormals, infinities and NaN too; most of them are missing then
anything = st.floats(width=32)
plausible = st.floats(0.0009999999310821295, 1e5, width=32)


@pytest.mark.parametrize("preset", PRESETS)
@settings(max_examples=200 if LONG else 12, derandomize=not LONG, database=None)
@given(values=st.lists(st.one_of(anything, plausible), min_size=1, max_size=12))
def test_depth_over_the_whole_range_of_floats(preset: str | None, values: list[float]) -> None:
    depth = torch.zeros(24, 32)
    places = torch.randperm(24 * 32, generator=torch.Generator().manual_seed(len(values)))
    depth.view(-1)[places[: len(values)]] = torch.tensor(values)
    with suppress(InputError):  # nothing was measured
        _check(_complete(_completer(preset), depth))


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_in_every_precision(preset: str | None, dtype: torch.dtype) -> None:
    depth = torch.linspace(0.5, 8, 24 * 32).reshape(24, 32)
    depth[::2] = 0
    try:
        _check(_complete(_completer(preset, dtype), depth))
    except SteeredMarigoldError as error:  # a range that the steps of some presets leave
        if dtype != torch.float16 or "not finite" not in str(error):
            raise


def _patterns() -> dict[str, torch.Tensor]:
    nothing = torch.zeros(24, 32)
    cell, line, border, one = (nothing.clone() for _ in range(4))
    cell[8:12, 8:12] = 2.0
    line[12] = 2.0
    border[0], border[-1], border[:, 0], border[:, -1] = 1.0, 2.0, 3.0, 4.0
    one[5, 5] = 3.0
    everywhere = torch.full((24, 32), 1.5)
    return {"cell": cell, "line": line, "border": border, "one": one, "constant": everywhere}


@pytest.mark.parametrize("name", _patterns())
@pytest.mark.parametrize("preset", ["default", "fast", "paper"])
def test_measurements_in_one_place(preset: str, name: str) -> None:
    _check(_complete(_completer(preset), _patterns()[name]))


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 1), (1, 40), (64, 1), (3, 500), (500, 3)])
def test_thin_images(size: tuple[int, int]) -> None:
    """With the embedded checkpoint, whose image encoder has its own ideas of size."""
    completer = _embedded()
    _check(_complete(completer, torch.full(size, 2.0)))
    depth = torch.zeros(size)
    depth[0, 0] = 2.0
    _check(_complete(completer, depth))


@cache
def _embedded() -> SteeredCompleter:
    return SteeredCompleter.from_checkpoint("embedded", preset="fast", device="cpu")
