"""The linear codec: right where the VAE is linear, and out of the way where it is not."""

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from steered_marigold.diffusion.codec import DepthCodec
from steered_marigold.diffusion.linear_codec import LONGEST, LinearCodec

SIZE = 240, 320


class Quarters(DepthCodec):
    """A codec that is linear: the latents of a position are its four mean depths."""

    def __init__(self) -> None:
        pass

    def decode(self, latents: Tensor) -> Tensor:
        return F.interpolate(F.pixel_shuffle(latents, 2), SIZE, mode="bilinear")[:, 0]

    def encode(self, depth: Tensor) -> Tensor:
        return F.pixel_unshuffle(F.avg_pool2d(depth[:, None], 4), 2)


class Surprises(Quarters):
    """A codec whose latents nothing foretells."""

    def encode(self, depth: Tensor) -> Tensor:
        return torch.randn_like(super().encode(depth))


def smooth(seed: int, amplitude: float) -> Tensor:
    """A random smooth map."""
    coarse = torch.randn(1, 1, 6, 8, generator=torch.Generator().manual_seed(seed))
    return amplitude * F.interpolate(coarse, SIZE, mode="bicubic")[:, 0]


def run(codec: LinearCodec, exact: DepthCodec, steps: int) -> list[tuple[bool, Tensor, Tensor]]:
    """(went by the linear map, encoded, what the exact codec would give) of each step."""
    results = []
    for i in range(steps):
        decoded = codec.decode(Quarters().encode(smooth(i, 0.3)))
        target = decoded + smooth(100 + i, 0.1)
        before = codec.linear_steps
        encoded = codec.encode(target)
        results.append((codec.linear_steps > before, encoded, exact.encode(target)))
    return results


def test_two_exact_steps_then_ever_longer_stretches_without_the_vae() -> None:
    codec = LinearCodec(Quarters())
    linear = [step for step, _, _ in run(codec, Quarters(), 39)]
    expected = [False, False]
    for length in (1, 2, 4, LONGEST, LONGEST, LONGEST):
        expected += [True] * length + [False]
    assert linear == expected[:39]
    assert (codec.exact_steps, codec.linear_steps) == (linear.count(False), linear.count(True))


def test_where_the_codec_is_linear_so_is_the_answer() -> None:
    for linear, encoded, exact in run(LinearCodec(Quarters()), Quarters(), 12):
        if linear:
            torch.testing.assert_close(encoded, exact, rtol=0, atol=0.02)


def test_where_nothing_can_be_foretold_every_step_is_exact() -> None:
    codec = LinearCodec(Surprises())
    run(codec, Surprises(), 6)
    assert (codec.exact_steps, codec.linear_steps) == (6, 0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_latents_keep_their_precision(dtype: torch.dtype) -> None:
    codec = LinearCodec(Quarters())
    for i in range(3):
        decoded = codec.decode(Quarters().encode(smooth(i, 0.3)).to(dtype))
        encoded = codec.encode(decoded.float() + smooth(9, 0.1))
    assert codec.linear_steps == 1
    assert encoded.dtype == dtype
