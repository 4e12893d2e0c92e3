"""Monte Carlo results against analytic ones; its own standard uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri, stdtrit
from trial_models import Bent, Grown, ScaledT, Smooth

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo


@pytest.mark.parametrize("control", [False, True])
@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_bent_normal(bend: float, control: bool) -> None:
    model = Bent(bend, control)
    result = monte_carlo(model, seed=8, trials=400_000)
    for name, exact in model.exact.items():
        # The ends are exact up to the far branch of the parabola, beyond 10 u.
        error = getattr(result, name)[0] - exact
        assert abs(error) <= 4 * getattr(result, f"se_{name}")[0] + 1e-8, name


def test_first_order_form_that_is_not_normal_serves_mean_and_u() -> None:
    class Rectangle:
        names = ("y",)
        linear_mean = np.zeros(1)
        linear_variance = np.array([1.0 / 3.0])

        def draw(self, rng: np.random.Generator, m: int) -> Draws:
            x = rng.uniform(-1.0, 1.0, (1, m))
            return Draws(values=x + 0.01 * x**2, linear=x)

    result = monte_carlo(Rectangle(), seed=1, trials=100_000)
    # Without the control u/sqrt(n), and a like share of u.
    assert result.se_mean[0] < 0.1 * result.u[0] / np.sqrt(100_000)
    assert result.se_u[0] < 0.1 * result.u[0] / np.sqrt(100_000)
    assert result.mean[0] == pytest.approx(0.01 / 3.0, abs=4 * result.se_mean[0])
    exact = np.sqrt(1.0 / 3.0 + 1e-4 * (1.0 / 5.0 - 1.0 / 9.0))
    assert result.u[0] == pytest.approx(exact, abs=4 * result.se_u[0])


@pytest.mark.parametrize("probability", [0.5, 0.999])
def test_other_probabilities(probability: float) -> None:
    result = monte_carlo(Bent(control=False), seed=6, trials=1_100_000, probability=probability)
    k = 2.0 * float(ndtri(0.5 + probability / 2.0))
    assert result.blocks >= 10
    assert result.low[0] == pytest.approx(3.0 - k, abs=4 * result.se_low[0])
    assert result.high[0] == pytest.approx(3.0 + k, abs=4 * result.se_high[0])


@pytest.mark.parametrize("dof", [3.0, 5.0, 30.0])
def test_a_t_that_is_its_own_first_order_form(dof: float) -> None:
    result = monte_carlo(ScaledT(dof), seed=3, trials=400_000)
    exact = float(stdtrit(dof, 0.975))
    assert result.low[0] == pytest.approx(-exact, abs=4 * result.se_low[0])
    assert result.high[0] == pytest.approx(exact, abs=4 * result.se_high[0])
    if dof > 4.0:
        assert result.u[0] == pytest.approx(np.sqrt(dof / (dof - 2.0)), abs=5 * result.se_u[0])


@pytest.mark.parametrize("dof", [1.0, 2.0])
def test_without_a_standard_deviation_only_intervals(dof: float) -> None:
    result = monte_carlo(ScaledT(dof), seed=3)
    assert np.isnan(result.u[0])
    assert np.isnan(result.covariance[0, 0])
    assert np.isnan(result.se_mean[0])
    assert result.converged
    assert result.high[0] == pytest.approx(stdtrit(dof, 0.975), abs=4 * result.se_high[0])
    few = monte_carlo(ScaledT(dof), seed=3, trials=1000)
    assert np.isnan(few.u[0])
    assert np.isfinite(few.high[0])


def scatter_as_stated(model: Bent | Grown, results: list[MonteCarloResult], of_se: float) -> None:
    """Mean squared error over mean se^2: chi-square of the seeds, less what se itself scatters."""
    seeds = len(results)
    for name, exact in model.exact.items():
        error = np.array([getattr(r, name)[0] for r in results]) - exact
        se = np.array([getattr(r, f"se_{name}")[0] for r in results])
        four_sigma = 4.0 * np.sqrt((2.0 + of_se) / seeds)
        assert abs(np.mean(error**2) / np.mean(se**2) - 1.0) < four_sigma + 0.1, name
        assert abs(error.mean()) < 4.0 * np.sqrt(np.mean(se**2) / seeds) + 1e-12, name


@pytest.mark.parametrize("trials", [8_003, None])
@pytest.mark.parametrize("model", [Smooth(0.05), Grown(0.5)])
def test_few_trials_of_a_smooth_model(model: Smooth | Grown, trials: int | None) -> None:
    """Unbiased, with the scatter stated, over 200 seeds; se^2 of ten blocks has 2/9 itself."""
    seeds = 200
    results = [
        monte_carlo(model, seed=s, trials=trials, tolerance_fraction=0.5, threads=1)
        for s in range(seeds)
    ]
    assert {r.blocks for r in results} == {10} or trials is None
    scatter_as_stated(model, results, 2.0 / 9.0)


@pytest.mark.parametrize("trials", [2_000, 20_000])
@pytest.mark.parametrize("control", [False, True])
def test_scatter_over_seeds_is_the_stated_one(control: bool, trials: int) -> None:
    """mean squared error over mean se^2: chi-square with 200, less what se itself scatters."""
    model = Bent(0.05, control)
    seeds = 200
    results = [monte_carlo(model, seed=s, trials=trials, threads=1) for s in range(seeds)]
    scatter_as_stated(model, results, 2.0 / 8.0 if trials >= 20_000 else 2.0 / 20.0)
