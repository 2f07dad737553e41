"""The final solve: a direct sparse solution as reference, and what it promises."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from steered_marigold.core import consistency
from steered_marigold.core.consistency import SensorNoise, agree_with_measurements, solve_correction

HEIGHT, WIDTH = 40, 56


def smooth_depth() -> torch.Tensor:
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    depth = 2 + 0.02 * x + 0.3 * torch.sin(y / 9)
    return torch.where(x > 30, depth + 1.5, depth)


def direct_solution(
    prior: torch.Tensor, measured: torch.Tensor, weight: torch.Tensor
) -> torch.Tensor:
    """The normal equations of the module's energy, assembled pixel by pixel and solved exactly."""
    log_prior = prior.log().double().numpy()
    index = np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    rows, columns, values = [], [], []
    for (y, x), i in np.ndenumerate(index):
        diagonal = float(weight[y, x]) + consistency.SCREENING
        for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            if not (0 <= y + dy < HEIGHT and 0 <= x + dx < WIDTH):
                continue
            step = (log_prior[y + dy, x + dx] - log_prior[y, x]) / consistency.DEPTH_EDGE
            w = max(1 / (1 + step**2), 1e-4) / consistency.STEP_SPREAD**2
            rows.append(i)
            columns.append(index[y + dy, x + dx])
            values.append(-w)
            diagonal += w
        rows.append(i)
        columns.append(i)
        values.append(diagonal)
    matrix = coo_array((values, (rows, columns))).tocsr()
    residual = torch.where(weight > 0, measured.log() - prior.log(), 0.0)
    right = (weight * residual).double().numpy().ravel()
    return torch.from_numpy(spsolve(matrix, right).reshape(HEIGHT, WIDTH))


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_equals_the_direct_solution(share: float) -> None:
    generator = torch.Generator().manual_seed(0)
    truth = smooth_depth()
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    prior = truth * (1 + 0.1 * torch.sin(x / 15) + 0.05 * torch.cos(y / 12))
    known = torch.rand(HEIGHT, WIDTH, generator=generator) < share
    known[10:30, 15:45] = False
    weight = torch.where(known, 1e4, 0.0)
    expected = direct_solution(prior, truth, weight)
    result = solve_correction(prior.log(), truth.log(), weight, None)
    assert (result - expected).abs().max() < 0.01
    assert (result - expected).abs().mean() < 0.001


@given(seed=st.integers(0, 1000), share=st.floats(0.001, 1.0))
@settings(max_examples=20, deadline=None)
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
    depth = agree_with_measurements(
        smooth_depth(), wrong, trusted, noise=SensorNoise(), confidence=confidence
    )
    assert (depth - smooth_depth()).abs().max() < 0.01


def test_same_input_same_bits() -> None:
    trusted = torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0)) < 0.1
    runs = [
        agree_with_measurements(smooth_depth() * 1.2, smooth_depth(), trusted, noise=SensorNoise())
        for _ in range(2)
    ]
    assert torch.equal(*runs)
