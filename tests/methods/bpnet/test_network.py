import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from steered_marigold.errors import NoMeasurementsError
from steered_marigold.methods.bpnet import BPNet
from steered_marigold.methods.bpnet.preprocessing import (
    BilateralPropagation,
    WeightedPool,
    nearest_measured,
)
from steered_marigold.methods.bpnet.refinement import (
    KernelGenerator,
    Refinement,
    local_convolution,
)
from tests.methods.published import checksum, names_and_shapes, published_list

PUBLISHED = "34842ad57ddfaccb9ec668c7b413718dd1984bab93512e60d9786bf9cb75b48a"
K = torch.tensor([[60.0, 0, 31], [0, 62, 30], [0, 0, 1]])


def frames(height: int, width: int, *, density: float = 0.05) -> tuple[Tensor, Tensor, Tensor]:
    """Two images, their depths and samples of them."""
    generator = torch.Generator().manual_seed(5)
    image = torch.randn(2, 3, height, width, generator=generator)
    depth = 2 + torch.linspace(0, 3, width).expand(2, 1, height, width)
    depth = depth + (image[:, :1] > 0)
    sampled = torch.rand(depth.shape, generator=generator) < density
    return image, depth, depth * sampled


def test_names_and_shapes_are_the_published_ones() -> None:
    with torch.device("meta"):
        network = BPNet()
    assert names_and_shapes(network) == PUBLISHED
    assert len(network.state_dict()) == 1648
    assert sum(parameter.numel() for parameter in network.parameters()) == 89_873_730


def test_the_checksum_is_that_of_the_published_list() -> None:
    lines = published_list("bpnet")
    if not lines:
        pytest.skip("the list of names and shapes is not on this machine")
    assert checksum(lines) == PUBLISHED


@settings(max_examples=40)
@given(
    st.integers(1, 9), st.integers(1, 12), st.sampled_from([0.02, 0.2, 0.9]), st.integers(0, 999)
)
def test_nearest_measured_is_a_search_through_all(
    height: int, width: int, density: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    measured = rng.random((height, width)) < density
    measured[rng.integers(height), rng.integers(width)] = True
    indices, offsets = nearest_measured(torch.from_numpy(measured))
    points = [(y, x) for y in range(height) for x in range(width) if measured[y, x]]
    for pixel in range(height * width):
        y, x = divmod(pixel, width)
        found: list[tuple[int, tuple[int, int]]] = []
        for point in points:
            distance = (point[0] - y) ** 2 + (point[1] - x) ** 2
            place = sum(other < distance for other, _ in found)
            found.insert(place, (distance, point))
        nearest = [point for _, point in found[:4]]
        nearest += [nearest[-1]] * (4 - len(nearest))
        assert indices[:, pixel].tolist() == [py * width + px for py, px in nearest]
        assert offsets[0, :, pixel].tolist() == [px - x for _, px in nearest]
        assert offsets[1, :, pixel].tolist() == [py - y for py, _ in nearest]


def test_nothing_to_search() -> None:
    with pytest.raises(NoMeasurementsError):
        nearest_measured(torch.zeros(3, 4, dtype=torch.bool))


@pytest.mark.parametrize("side", [3, 5, 7])
def test_local_convolution_is_a_loop(side: int) -> None:
    generator = torch.Generator().manual_seed(side)
    depth = torch.rand(2, 1, 5, 6, generator=generator, dtype=torch.float64)
    kernels = torch.randn(2, side**2, 5, 6, generator=generator, dtype=torch.float64)
    expected = torch.zeros_like(depth)
    reach = side // 2
    for b, y, x, i, j in np.ndindex(2, 5, 6, side, side):
        row, column = y + i - reach, x + j - reach
        if 0 <= row < 5 and 0 <= column < 6:
            expected[b, 0, y, x] += kernels[b, i * side + j, y, x] * depth[b, 0, row, column]
    torch.testing.assert_close(local_convolution(depth, kernels), expected)


@torch.no_grad()
def test_weighted_pool_is_a_softmax_average_of_each_cell() -> None:
    generator = torch.Generator().manual_seed(2)
    pool = WeightedPool(6, level=2).eval()
    features = torch.randn(1, 6, 3, 4, generator=generator)
    logits = 30 * pool.permute(features)
    pool.permute.register_forward_hook(lambda *_: logits)
    sparse = 1 + torch.rand(1, 1, 12, 16, generator=generator)
    sparse *= torch.rand(sparse.shape, generator=generator) < 0.3
    sparse[..., :4, :4] = 0
    pooled = pool(sparse, features)
    for y, x in np.ndindex(3, 4):
        depth = sparse[0, 0, 4 * y : 4 * y + 4, 4 * x : 4 * x + 4].flatten()
        weights = logits[0, :, y, x][depth > 0].softmax(0)
        expected = (weights * depth[depth > 0]).sum()
        torch.testing.assert_close(pooled[0, 0, y, x], expected, rtol=1e-4, atol=0)


def test_weighted_pool_has_finite_gradients_in_empty_cells() -> None:
    pool = WeightedPool(4, level=1)
    features = torch.ones(2, 4, 2, 2, requires_grad=True)
    sparse = torch.zeros(2, 1, 4, 4)
    sparse[..., 0, :2] = torch.tensor([1.0, 3.0])
    pool(sparse, features).sum().backward()
    assert features.grad is not None
    assert features.grad.isfinite().all()


@torch.no_grad()
def test_propagation_without_its_perceptron_averages_the_neighbours() -> None:
    propagation = BilateralPropagation(3).eval()
    for parameter in propagation.coef.parameters():
        parameter.zero_()
    points = torch.zeros(1, 3, 4, 8)
    points[0, 2, 0, 0], points[0, 2, 3, 5], points[0, 2, 1, 2] = 1, 2, 3
    depth = propagation(torch.rand(1, 3, 4, 8), points)
    # three points: the farthest counts twice
    assert depth[0, 0, 0, 0].item() == pytest.approx((1 + 3 + 2 + 2) / 4)
    assert depth[0, 0, 3, 7].item() == pytest.approx((2 + 3 + 1 + 1) / 4)


@torch.no_grad()
def test_kernels_sum_to_one_and_the_neighbours_to_at_most_one_in_size() -> None:
    kernels = KernelGenerator(4, 5).eval()(torch.randn(2, 4, 6, 7))
    torch.testing.assert_close(kernels.sum(dim=1), torch.ones(2, 6, 7))
    around = torch.cat((kernels[:, :12], kernels[:, 13:]), dim=1)
    assert (around.abs().sum(dim=1) <= 1 + 1e-6).all()


@torch.no_grad()
def test_refinement_keeps_a_plane_of_constant_depth_away_from_the_border() -> None:
    refined = Refinement(4, steps=2).eval()(
        torch.randn(1, 4, 20, 24), torch.full((1, 1, 20, 24), 2.5), torch.zeros(1, 1, 20, 24)
    )
    torch.testing.assert_close(refined[..., 6:-6, 6:-6], torch.full((1, 1, 8, 12), 2.5))


def test_over_fits_two_frames() -> None:
    torch.manual_seed(0)
    network = BPNet(width=4).train()
    image, depth, sparse = frames(32, 64)
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-2)
    for _ in range(14):
        loss = (network(image, sparse, K) - depth).square().mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 0.1)
        optimizer.step()
    # better than the best constant
    assert loss < depth.var() / 1.5


@pytest.mark.slow
@torch.no_grad()
@pytest.mark.parametrize(("height", "width"), [(256, 320), (448, 608)])
def test_full_size(height: int, width: int) -> None:
    image, _, sparse = frames(height, width)
    depth = BPNet().eval()(image[:1], sparse[:1], K)
    assert depth.shape == (1, 1, height, width)
    assert depth.isfinite().all()
