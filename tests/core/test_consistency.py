"""The final solve: a direct sparse solution as reference, and what it promises."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from steered_marigold.core import consistency
from steered_marigold.core.consistency import SensorNoise, agree_with_measurements, solve_log_depth

HEIGHT, WIDTH = 40, 56


def smooth_depth(edge: int = 30) -> torch.Tensor:
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    depth = 2 + 0.02 * x + 0.3 * torch.sin(y / 9)
    return torch.where(x > edge, depth + 1.5, depth)


def direct_solution(
    prior: torch.Tensor, measured: torch.Tensor, weight: torch.Tensor
) -> torch.Tensor:
    """The module's energy as printed, one equation a row, solved by least squares."""
    log_prior = prior.log().double().numpy()
    distance = distance_transform_edt((weight == 0).numpy())
    trust = 1 - np.exp(-distance / consistency.PRIOR_REACH)
    index = np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    rows: list[dict[int, float]] = []
    right: list[float] = []

    def equation(root: float, terms: dict[int, float], value: float) -> None:
        rows.append({i: root * factor for i, factor in terms.items()})
        right.append(root * value)

    for (y, x), i in np.ndenumerate(index):
        for dy, dx in ((0, 1), (1, 0)):
            if y + dy < HEIGHT and x + dx < WIDTH:
                step = log_prior[y + dy, x + dx] - log_prior[y, x]
                w = max(1 / (1 + (step / consistency.DEPTH_EDGE) ** 2), 1e-4)
                f = (trust[y, x] + trust[y + dy, x + dx]) / 2
                j = int(index[y + dy, x + dx])
                equation(w**0.5 / consistency.STEP_SPREAD, {j: 1.0, int(i): -1.0}, f * step)
        if weight[y, x] > 0:
            equation(float(weight[y, x]) ** 0.5, {int(i): 1.0}, float(measured[y, x].log()))
        equation(consistency.SCREENING**0.5, {int(i): 1.0}, float(log_prior[y, x]))
    entries = [(r, c, v) for r, terms in enumerate(rows) for c, v in terms.items()]
    r, c, v = zip(*entries, strict=True)
    matrix = coo_array((v, (r, c)), shape=(len(rows), index.size)).tocsr()
    solution = spsolve((matrix.T @ matrix).tocsc(), matrix.T @ np.array(right))
    return torch.from_numpy(solution.reshape(HEIGHT, WIDTH))


def known_but_for_a_hole(share: float) -> torch.Tensor:
    known = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0)) < share
    known[10:30, 15:45] = False
    return known


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("edge", [31, 30])
def test_near_the_direct_solution(share: float, edge: int) -> None:
    """An edge between blocks of 2x2 pixels, then one through them."""
    truth = smooth_depth(edge)
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    prior = truth * (1 + 0.1 * torch.sin(x / 15) + 0.05 * torch.cos(y / 12))
    weight = torch.where(known_but_for_a_hole(share), 1e4, 0.0)
    expected = direct_solution(prior, truth, weight)
    error = (solve_log_depth(prior.log(), truth.log(), weight, None) - expected).abs()
    before = (prior.log() - expected).abs()
    assert error.mean() < 0.2 * before.mean()
    assert error.max() < 0.06
    if edge % 2:
        assert error.mean() < 0.05 * before.mean()
        assert error.max() < 0.02


@pytest.mark.parametrize("size", [(1, 1), (1, 30), (30, 1), (2, 2), (3, 700), (33, 47)])
def test_any_size(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(0)
    prior, truth = (1 + torch.rand(*size, generator=generator) for _ in range(2))
    trusted = torch.zeros(size, dtype=torch.bool)
    trusted[size[0] // 2, size[1] // 2] = True
    image = torch.rand(3, *size, generator=generator)
    depth = agree_with_measurements(prior, truth, trusted, noise=SensorNoise(), image=image)
    assert torch.equal(depth[trusted], truth[trusted])
    assert bool(torch.isfinite(depth).all())


def test_strips_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    trusted = known_but_for_a_hole(0.03)
    image = torch.rand(3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    prior = smooth_depth() * 1.1

    def solve() -> torch.Tensor:
        return agree_with_measurements(
            prior, smooth_depth(), trusted, noise=SensorNoise(), image=image
        )

    whole = solve()
    monkeypatch.setattr(consistency, "STRIP", 8 * WIDTH)
    torch.testing.assert_close(solve(), whole, atol=1e-5, rtol=0)


@given(seed=st.integers(0, 1000), share=st.floats(0.001, 1.0))
@settings(max_examples=20)
def test_exact_measurements_are_met_and_depth_stays_positive(seed: int, share: float) -> None:
    generator = torch.Generator().manual_seed(seed)
    prior = smooth_depth() * (1 + 0.2 * torch.rand(HEIGHT, WIDTH, generator=generator))
    trusted = torch.rand(HEIGHT, WIDTH, generator=generator) < share
    depth = agree_with_measurements(prior, smooth_depth(), trusted, noise=SensorNoise())
    assert torch.equal(depth[trusted], smooth_depth()[trusted])
    assert bool((depth > 0).all())
    assert bool(torch.isfinite(depth).all())


def test_a_prior_off_by_a_factor_is_put_right_by_one_point() -> None:
    trusted = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    trusted[20, 10] = True
    depth = agree_with_measurements(
        smooth_depth() * 1.1, smooth_depth(), trusted, noise=SensorNoise()
    )
    assert (depth / smooth_depth() - 1).abs().mean() < 0.06


def test_without_measurements_nothing_changes() -> None:
    nothing = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    depth = agree_with_measurements(smooth_depth(), smooth_depth(), nothing, noise=SensorNoise())
    assert torch.equal(depth, smooth_depth())


def test_noisy_measurements_are_smoothed() -> None:
    generator = torch.Generator().manual_seed(0)
    everywhere = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
    noisy = smooth_depth() * (1 + 0.1 * torch.randn(HEIGHT, WIDTH, generator=generator))
    depth = agree_with_measurements(
        smooth_depth() * 1.05, noisy, everywhere, noise=SensorNoise(fraction=0.1)
    )
    error = (depth - smooth_depth()).abs().mean()
    assert error < 0.3 * (noisy - smooth_depth()).abs().mean()


def test_zero_confidence_is_ignored() -> None:
    trusted = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    trusted[5:35:6, 5:50:6] = True
    wrong = smooth_depth().clone()
    wrong[:, :20] = 9.0
    confidence = torch.ones(HEIGHT, WIDTH)
    confidence[:, :20] = 0
    weighed = agree_with_measurements(
        smooth_depth(), wrong, trusted, noise=SensorNoise(), confidence=confidence
    )
    without = agree_with_measurements(
        smooth_depth(),
        smooth_depth(),
        trusted & (confidence > 0),
        noise=SensorNoise(),
        confidence=torch.ones_like(confidence),
    )
    torch.testing.assert_close(weighed, without)


def test_same_input_same_bits() -> None:
    trusted = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0)) < 0.1
    runs = [
        agree_with_measurements(smooth_depth() * 1.2, smooth_depth(), trusted, noise=SensorNoise())
        for _ in range(2)
    ]
    assert torch.equal(*runs)
