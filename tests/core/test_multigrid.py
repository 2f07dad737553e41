"""Multigrid against a direct solution of the same equations."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve
from torch import Tensor

from steered_marigold.core.multigrid import BLACK, RED, Equations, Level, Multigrid, to_phases


def random_equations(rows: int, columns: int, seed: int) -> tuple[Equations, Tensor]:
    """Couplings from 1e-4 to 1, data at a few pixels, a weak pull to 0 elsewhere."""
    generator = torch.Generator().manual_seed(seed)
    right, down = (
        10 ** (-4 * torch.rand(rows, columns, generator=generator) ** 4) for _ in range(2)
    )
    right[:, -1], down[-1] = 0, 0
    weight = torch.full((rows, columns), 1e-3)
    known = torch.rand(rows, columns, generator=generator) < 0.05
    known[rows // 2, columns // 2] = True
    weight[known] = 100.0
    return Equations(weight, right, down), torch.randn(rows, columns, generator=generator) * weight


def direct_solution(equations: Equations, data: Tensor) -> Tensor:
    """The same equations, one row of a sparse matrix each, in float64."""
    rows, columns = data.shape
    index = np.arange(data.numel()).reshape(rows, columns)
    i = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    j = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    coupling = np.concatenate(
        [equations.right[:, :-1].ravel().double(), equations.down[:-1].ravel().double()]
    )
    diagonal = equations.weight.ravel().double().numpy()
    diagonal = diagonal + np.bincount(i, coupling, data.numel())
    diagonal = diagonal + np.bincount(j, coupling, data.numel())
    matrix = coo_array(
        (
            np.concatenate([diagonal, -coupling, -coupling]),
            (np.concatenate([index.ravel(), i, j]), np.concatenate([index.ravel(), j, i])),
        )
    )
    solution = np.atleast_1d(spsolve(matrix.tocsc(), data.ravel().double().numpy()))
    return torch.from_numpy(solution.reshape(rows, columns)).float()


@pytest.mark.parametrize(
    "size", [(1, 1), (2, 2), (1, 900), (900, 1), (2, 333), (37, 41), (64, 96), (101, 30)]
)
def test_equals_the_direct_solution(size: tuple[int, int]) -> None:
    equations, data = random_equations(*size, seed=0)
    result = Multigrid(equations, iterations=200).solve(data)
    torch.testing.assert_close(result, direct_solution(equations, data), atol=2e-3, rtol=0)


def test_more_iterations_come_nearer() -> None:
    equations, data = random_equations(120, 160, seed=1)
    expected = direct_solution(equations, data)
    errors = [
        float((Multigrid(equations, iterations=n).solve(data) - expected).square().mean())
        for n in (1, 3, 6, 12)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-2 * errors[0]


def test_nothing_asked_nothing_answered() -> None:
    equations, data = random_equations(40, 50, seed=2)
    result = Multigrid(equations, iterations=3).solve(torch.zeros_like(data))
    assert torch.equal(result, torch.zeros_like(data))


@given(rows=st.integers(1, 9), columns=st.integers(1, 9), seed=st.integers(0, 100))
@settings(max_examples=10)
def test_a_level_multiplies_and_its_sweeps_converge(rows: int, columns: int, seed: int) -> None:
    equations, data = random_equations(rows, columns, seed)
    level = Level(equations)
    level.u.copy_(to_phases(direct_solution(equations, data)))
    torch.testing.assert_close(level.times(), to_phases(data), atol=1e-3, rtol=1e-3)
    level.data.copy_(to_phases(data))
    level.u.zero_()
    for _ in range(1500):
        level.sweep(RED + BLACK)
    expected = direct_solution(equations, data)
    # slow for smooth errors, which is why there are coarser grids
    assert float((level.to_map() - expected).norm()) <= 0.1 * float(expected.norm()) + 1e-3
