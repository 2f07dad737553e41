import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm, spearmanr
from sklearn.metrics import (
    mean_absolute_error,
    mean_absolute_percentage_error,
    root_mean_squared_error,
)

from steered_marigold.core.metrics import (
    COVERAGE_LEVELS,
    DROPPED_SHARES,
    depth_errors,
    exact_mean,
    seam_step,
    uncertainty_curves,
    uncertainty_errors,
)
from steered_marigold.errors import InputError

Images = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
seeds = st.integers(0, 2**31)


def images(seed: int, *, negative: bool = False) -> Images:
    """Prediction, truth and mask [1, 6, 8]; the prediction partly below zero if asked."""
    generator = torch.Generator().manual_seed(seed)
    truth = 0.3 + 9 * torch.rand(1, 6, 8, generator=generator)
    prediction = truth * (0.5 + torch.rand(1, 6, 8, generator=generator))
    if negative:
        prediction -= 2
    mask = torch.rand(1, 6, 8, generator=generator) < 0.7
    mask[:, 0, 0] = True
    return prediction, truth, mask


@given(seeds)
def test_agrees_with_scikit_learn_and_numpy(seed: int) -> None:
    prediction, truth, mask = (x[0] for x in images(seed))
    errors = depth_errors(prediction, truth, mask)
    d, g = prediction[mask].double().numpy(), truth[mask].double().numpy()
    assert errors.rmse_m == pytest.approx(root_mean_squared_error(g, d), abs=1e-6)
    assert errors.mae_m == pytest.approx(mean_absolute_error(g, d), abs=1e-6)
    assert errors.abs_rel == pytest.approx(mean_absolute_percentage_error(g, d), abs=1e-6)
    assert errors.imae_per_km == pytest.approx(1000 * mean_absolute_error(1 / g, 1 / d), rel=1e-9)
    assert errors.irmse_per_km == pytest.approx(
        1000 * root_mean_squared_error(1 / g, 1 / d), rel=1e-9
    )
    for power, delta in enumerate((errors.delta1, errors.delta2, errors.delta3), start=1):
        inliers = sum(max(p / t, t / p) < 1.25**power for p, t in zip(d, g, strict=True))
        assert delta == pytest.approx(inliers / len(d), abs=1e-12)


@given(seeds)
def test_laws(seed: int) -> None:
    prediction, truth, mask = (x[0] for x in images(seed, negative=True))
    errors = depth_errors(prediction, truth, mask)
    assert errors.rmse_m >= errors.mae_m
    assert errors.delta1 <= errors.delta2 <= errors.delta3
    perfect = depth_errors(truth, truth, mask)
    assert (perfect.rmse_m, perfect.abs_rel, perfect.delta1) == (0, 0, 1)
    elsewhere = torch.where(mask, prediction, torch.nan)
    assert depth_errors(elsewhere, truth, mask) == errors


def test_a_negative_prediction_is_an_outlier_except_officially() -> None:
    prediction = torch.tensor([[-1.0, 0.0, 2.0, 1.0]])
    truth, mask = torch.tensor([[2.0, 2.0, 2.0, 2.0]]), torch.ones(1, 4, dtype=torch.bool)
    ours = depth_errors(prediction, truth, mask)
    official = depth_errors(prediction, truth, mask, official=True)
    assert (ours.delta1, ours.delta2, ours.delta3) == (0.25, 0.25, 0.25)
    assert (official.delta1, official.delta2, official.delta3) == (0.5, 0.5, 0.5)
    assert math.isinf(ours.irmse_per_km)
    assert ours.rmse_m == official.rmse_m


def test_exact_mean_keeps_what_a_plain_sum_loses() -> None:
    values = [1e16, 1.0, -1e16]
    assert exact_mean(values) == 1 / 3


@given(seeds)
def test_uncertainty_against_plain_definitions(seed: int) -> None:
    prediction, truth, mask = (x[0] for x in images(seed))
    generator = torch.Generator().manual_seed(seed + 1)
    sigma = torch.randint(1, 6, truth.shape, generator=generator) / 4  # with ties
    errors = uncertainty_errors(prediction, sigma, truth, mask)
    e = (prediction - truth).abs()[mask].double().numpy()
    s = sigma[mask].double().numpy()
    if len(np.unique(s)) > 1:
        assert errors.spearman == pytest.approx(spearmanr(s, e).statistic, abs=1e-9)
    assert errors.coverage90 == pytest.approx(np.mean(e <= 1.645 * s))


def test_ause_by_hand() -> None:
    truth, mask = torch.ones(1, 4), torch.ones(1, 4, dtype=torch.bool)
    prediction = truth + torch.tensor([[1.0, 2.0, 3.0, 4.0]])
    reverse = torch.tensor([[4.0, 3.0, 2.0, 1.0]])
    kept = [4 - 1, (4 + 3) / 2 - 1.5, 3 - 2, 0]  # MAE of the 1, 2, 3, 4 surest less the oracle's
    errors = uncertainty_errors(prediction, reverse, truth, mask)
    assert errors.ause == pytest.approx(sum(kept) / 4 / 2.5)
    assert errors.spearman == pytest.approx(-1)


@given(seeds)
def test_the_error_itself_is_the_perfect_uncertainty(seed: int) -> None:
    prediction, truth, mask = (x[0] for x in images(seed))
    perfect = uncertainty_errors(prediction, (prediction - truth).abs(), truth, mask)
    assert perfect.ause == pytest.approx(0, abs=1e-5)
    assert perfect.coverage90 == 1
    constant = uncertainty_errors(prediction, torch.ones_like(truth), truth, mask)
    assert constant.spearman == 0
    assert constant.ause >= perfect.ause


@given(seeds)
def test_curves_against_plain_definitions(seed: int) -> None:
    prediction, truth, mask = (x[0] for x in images(seed))
    sigma = 0.1 + torch.rand(truth.shape, generator=torch.Generator().manual_seed(seed + 1))
    curves = uncertainty_curves(prediction, sigma, truth, mask)
    e = (prediction - truth).abs()[mask].double().numpy()
    s = sigma[mask].double().numpy()
    for level, share in zip(COVERAGE_LEVELS, curves.coverage, strict=True):
        assert share == pytest.approx(np.mean(e <= norm.ppf((1 + level) / 2) * s))
    for index, dropped in enumerate(DROPPED_SHARES):
        kept = max(1, round((1 - dropped) * len(e)))
        surest = e[np.argsort(s)][:kept].mean() / e.mean()
        assert curves.by_uncertainty[index] == pytest.approx(surest)
        assert curves.by_error[index] == pytest.approx(np.sort(e)[:kept].mean() / e.mean())


def test_true_uncertainty_covers_what_it_says() -> None:
    truth = torch.full((200, 200), 50.0)
    generator = torch.Generator().manual_seed(0)
    sigma = 0.1 + torch.rand(truth.shape, generator=generator)
    prediction = truth + sigma * torch.randn(truth.shape, generator=generator)
    curves = uncertainty_curves(prediction, sigma, truth, torch.ones_like(truth, dtype=torch.bool))
    assert curves.coverage == pytest.approx(COVERAGE_LEVELS, abs=0.01)
    assert curves.by_uncertainty[0] == curves.by_error[0] == pytest.approx(1)
    assert curves.by_error[-1] < curves.by_uncertainty[-1] < 0.5


def bordered(seed: int = 0) -> Images:
    """A smooth truth with some noise, all of it valid, and a rectangle that is not known."""
    generator = torch.Generator().manual_seed(seed)
    slope = torch.linspace(2, 3, 40)[None, :] + torch.linspace(0, 1, 30)[:, None]
    truth = slope * (1 + 0.002 * torch.randn(30, 40, generator=generator))
    known = torch.ones(30, 40, dtype=torch.bool)
    known[8:20, 10:25] = False
    return truth, torch.ones_like(known), known


@given(seeds, st.floats(0.2, 5))
def test_the_truth_has_no_seam_at_any_scale(seed: int, scale: float) -> None:
    truth, mask, known = bordered(seed)
    assert seam_step(truth * scale, truth, mask, known) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("jump", [0.05, 0.2, -0.2])
def test_seam_is_the_jump(jump: float) -> None:
    truth, mask, known = bordered()
    smooth = torch.full_like(truth, 2.0)
    torn = torch.where(known, smooth, smooth * math.exp(jump))
    constant = torch.full_like(truth, 3.0)
    assert seam_step(torn, constant, mask, known) == pytest.approx(abs(jump), abs=1e-6)
    noisy = torch.where(known, truth, truth * math.exp(jump))
    assert seam_step(noisy, truth, mask, known) == pytest.approx(abs(jump), abs=0.02)


def test_a_slope_is_no_seam() -> None:
    truth, mask, known = bordered()
    exponential = torch.exp(torch.arange(40.0) / 50)[None, :].expand(30, 40)
    plane = torch.full_like(truth, 2.0)
    assert seam_step(exponential, plane, mask, known) == pytest.approx(0, abs=1e-6)


def test_edges_and_unknown_truth_do_not_count() -> None:
    truth, mask, known = bordered()
    torn = torch.where(known, truth, 2 * truth)
    assert seam_step(torn, torn, mask, known) is None  # an edge of the truth all along
    assert seam_step(torn, truth, mask & known, known) is None
    assert seam_step(torn, truth, mask, mask) is None
    few = mask.clone()
    few[:, 14:] = False
    assert seam_step(torn, truth, few, known) is None  # 12 + 2 x 2 fours
    half = mask.clone()
    half[:, 20:] = False
    broken = torch.where(half, torn, torch.nan)
    step = seam_step(broken, truth, half, known)
    assert step is not None
    assert step == pytest.approx(math.log(2), abs=0.02)


def test_bad_input() -> None:
    prediction, truth, mask = (x[0] for x in images(0))
    with pytest.raises(InputError, match="no pixel"):
        depth_errors(prediction, truth, torch.zeros_like(mask))
    with pytest.raises(InputError, match="positive"):
        depth_errors(prediction, truth - 20, mask)
    with pytest.raises(InputError, match="not finite"):
        depth_errors(prediction * torch.inf, truth, mask)
    with pytest.raises(InputError, match="uncertainty"):
        uncertainty_errors(prediction, prediction * torch.nan, truth, mask)
    with pytest.raises(InputError, match="no images"):
        exact_mean([])
