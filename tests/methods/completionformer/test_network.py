import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from steered_marigold.methods.completionformer import CompletionFormer
from steered_marigold.methods.completionformer.propagation import (
    NonLocalPropagation,
    bilinear_reads,
    kernel_reads,
    sample,
)
from steered_marigold.methods.completionformer.pyramid import Attention, Pyramid, Stage
from tests.methods.published import checksum, names_and_shapes, published_list

PUBLISHED = "ea300c71a7a04ff2da0e232943643675f580b28f75e6ef42954789d76d2eaf47"


def test_names_and_shapes_are_the_published_ones() -> None:
    with torch.device("meta"):
        network = CompletionFormer()
    assert names_and_shapes(network) == PUBLISHED
    assert len(network.state_dict()) == 783
    assert sum(parameter.numel() for parameter in network.parameters()) == 83_505_336


def test_the_checksum_is_that_of_the_published_list() -> None:
    lines = published_list("completionformer")
    if not lines:
        pytest.skip("the list of names and shapes is not on this machine")
    assert checksum(lines) == PUBLISHED


@pytest.mark.parametrize(("height", "width"), [(228, 304), (448, 608), (252, 1216), (32, 37)])
def test_sizes_that_are_no_multiples_of_32_need_no_padding(height: int, width: int) -> None:
    with torch.device("meta"):
        network = CompletionFormer().eval()
        depth = network(torch.empty(1, 3, height, width), torch.empty(1, 1, height, width))
    assert depth.shape == (1, 1, height, width)


def test_pyramid_halves_five_times_and_rounds_down() -> None:
    with torch.device("meta"):
        outputs = Pyramid(64)(torch.empty(1, 64, 228, 304))
    assert [tuple(output.shape[1:]) for output in outputs] == [
        (64, 228, 304),
        (128, 114, 152),
        (64, 57, 76),
        (128, 28, 38),
        (320, 14, 19),
        (512, 7, 9),
    ]


@settings(max_examples=12)
@given(st.sampled_from([1, 3]), st.integers(1, 5), st.integers(1, 5), st.integers(0, 999))
def test_a_deformable_convolution_is_a_loop(side: int, height: int, width: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)

    def random(*size: int) -> torch.Tensor:
        return torch.randn(*size, generator=generator, dtype=torch.float64)

    x = random(2, 1, height, width)
    offsets = 3 * random(2, side**2, 2, height, width)
    offsets[0] = offsets[0].round()
    expected = torch.zeros(2, side**2, height, width, dtype=torch.float64)
    for b, y, x_, i, j in np.ndindex(2, height, width, side, side):
        tap = i * side + j
        row = y + i - side // 2 + offsets[b, tap, 0, y, x_].item()
        column = x_ + j - side // 2 + offsets[b, tap, 1, y, x_].item()
        for v, u in np.ndindex(height, width):
            share = max(0, 1 - abs(row - v)) * max(0, 1 - abs(column - u))
            expected[b, tap, y, x_] += share * x[b, 0, v, u]
    torch.testing.assert_close(sample(x, kernel_reads(offsets)), expected)


def scipy_samples(image: torch.Tensor, offsets: torch.Tensor) -> np.ndarray:
    """Bilinear samples of one image at pixel + offset, [samples, height, width], in float64."""
    pixels = np.indices(image.shape[2:])
    return np.stack(
        [
            map_coordinates(image[0, 0].double().numpy(), place, order=1, mode="grid-constant")
            for place in pixels + offsets[0].double().numpy()
        ]
    )


def test_float32_samples_of_a_wide_image_are_exact_to_float32() -> None:
    generator = torch.Generator().manual_seed(0)
    image = 80 * torch.rand(1, 1, 40, 1216, generator=generator)
    offsets = 4 * torch.randn(1, 9, 2, 40, 1216, generator=generator)
    samples = sample(image, bilinear_reads(offsets))[0].numpy()
    # coordinates in [-1, 1], or pixel + offset in one float32, are wrong by 1e-3 and more
    np.testing.assert_allclose(samples, scipy_samples(image, offsets), atol=4e-5, rtol=0)


@torch.no_grad()
def test_propagation_in_float32_equals_the_paper_written_in_float64() -> None:
    layer, generator = propagation(4), torch.Generator().manual_seed(4)
    depth = 10 * torch.rand(1, 1, 24, 608, generator=generator)
    guidance = torch.randn(1, 8, 24, 608, generator=generator)
    confidence = torch.rand(1, 1, 24, 608, generator=generator)
    out = layer.conv_offset_aff(guidance)
    shifts, raw = out[:, :16].unflatten(1, (8, 2)), out[0, 16:].double().numpy()
    affinity = np.tanh(raw / 100) / 4 * scipy_samples(confidence, shifts)
    affinity /= np.maximum(1, abs(affinity).sum(axis=0) + 1e-4)
    taps = torch.tensor([(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)])
    places = shifts.double() + taps.view(8, 2, 1, 1)
    expected = depth.double()
    for _ in range(6):
        moved = (affinity * scipy_samples(expected, places)).sum(axis=0)
        kept = (1 - affinity.sum(axis=0)) * expected[0, 0].numpy()
        expected = torch.from_numpy(moved + kept)[None, None]
    refined = layer(depth, guidance, confidence)
    # affinities of both signs amplify: values reach 286 m here, and coordinates in [-1, 1] are
    # wrong by 3.6e-2 m
    np.testing.assert_allclose(refined.numpy(), expected.numpy(), atol=5e-4, rtol=0)


@torch.no_grad()
def propagation(seed: int) -> NonLocalPropagation:
    """With shifts of some pixels and affinities that are not small."""
    layer = NonLocalPropagation()
    generator = torch.Generator().manual_seed(seed)
    for parameter in layer.conv_offset_aff.parameters():
        parameter.copy_(torch.randn(parameter.shape, generator=generator) / 4)
        parameter[16:] *= 400
    return layer


@torch.no_grad()
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_affinities_sum_to_at_most_one_in_size(seed: int) -> None:
    layer, generator = propagation(seed), torch.Generator().manual_seed(seed)
    affinity, shifts = (
        300 * torch.randn(1, 8, 6, 7, generator=generator),
        torch.zeros(1, 8, 2, 6, 7),
    )
    normalized = layer._normalize(affinity, shifts, torch.ones(1, 1, 6, 7))
    size = normalized.abs().sum(dim=1)
    assert (size <= 1).all()
    # the tanh is scaled by gamma = 4, so sums below 1 stay as they are
    small = layer._normalize(affinity / 1000, shifts, torch.ones(1, 1, 6, 7))
    torch.testing.assert_close(small, torch.tanh(affinity / 100_000) / 4)


@torch.no_grad()
def test_no_confidence_no_propagation() -> None:
    depth, guidance = torch.rand(2, 1, 9, 8), torch.randn(2, 8, 9, 8)
    refined = propagation(0)(depth, guidance, torch.zeros(2, 1, 9, 8))
    torch.testing.assert_close(refined, depth)
    assert not torch.allclose(propagation(0)(depth, guidance, torch.ones(2, 1, 9, 8)), depth)


@torch.no_grad()
def test_constant_depth_stays_away_from_the_border() -> None:
    layer, guidance = propagation(3), torch.rand(1, 8, 60, 60).clamp(max=0.5)
    refined = layer(torch.full((1, 1, 60, 60), 2.0), guidance, torch.ones(1, 1, 60, 60))
    torch.testing.assert_close(refined[..., 28:32, 28:32], torch.full((1, 1, 4, 4), 2.0))


@torch.no_grad()
@pytest.mark.parametrize("reduction", [1, 2])
def test_attention_is_a_softmax_over_the_reduced_map(reduction: int) -> None:
    attention = Attention(8, Stage(heads=2, blocks=1, expansion=1, reduction=reduction, grid=1))
    x = torch.randn(1, 8, 5, 4)
    tokens = x.flatten(2).transpose(1, 2)
    source = tokens
    if reduction > 1:
        source = attention.norm(attention.sr(x).flatten(2).transpose(1, 2))
    query, (key, value) = attention.q(tokens), attention.kv(source).split(8, dim=-1)
    heads = []
    for head in (slice(0, 4), slice(4, 8)):
        scores = query[..., head] @ key[..., head].transpose(1, 2) / 4**0.5
        heads.append(scores.softmax(dim=-1) @ value[..., head])
    expected = attention.proj(torch.cat(heads, dim=-1))
    torch.testing.assert_close(attention(tokens, x), expected)


def test_over_fits_two_frames() -> None:
    torch.manual_seed(0)
    network = CompletionFormer(width=16).train()
    image = torch.randn(2, 3, 64, 64)
    depth = 2 + torch.linspace(0, 3, 64).expand(2, 1, 64, 64) + (image[:, :1] > 0)
    sparse = depth * (torch.rand(depth.shape) < 0.05)
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3)
    losses = []
    for _ in range(15):
        loss = (network(image, sparse) - depth).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < losses[0] / 5


@pytest.mark.slow
@torch.no_grad()
@pytest.mark.parametrize(("height", "width"), [(228, 304), (448, 608)])
def test_full_size(height: int, width: int) -> None:
    sparse = 3.0 * (torch.rand(1, 1, height, width) < 0.05)
    depth = CompletionFormer().eval()(torch.randn(1, 3, height, width), sparse)
    assert depth.shape == (1, 1, height, width)
    assert depth.isfinite().all()
    assert (depth >= 0).all()
