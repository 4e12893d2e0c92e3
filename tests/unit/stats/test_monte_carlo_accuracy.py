"""Monte Carlo: the adaptive count, clause 8, analytic results, its own standard uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import stdtrit
from trial_models import Bent, Other, ScaledT, Smooth, Z

from mtu_cli.findings import InputError
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, clause8, monte_carlo


def test_largest_count_ends_an_adaptive_run() -> None:
    result = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=100_000)
    assert not result.converged
    assert 90_000 < result.trials <= 100_000
    small = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=5_000)
    assert not small.converged
    assert small.trials == 5_000


@pytest.mark.parametrize(("bad", "trials"), [(np.nan, 1000), (np.inf, 40_000), (np.nan, None)])
def test_values_that_are_not_finite_are_counted(bad: float, trials: int | None) -> None:
    def formula(rng: np.random.Generator, m: int) -> FloatArray:
        values = rng.standard_normal((2, m))
        values[1, :7] = bad
        return values

    with pytest.raises(InputError, match=r"'worse' has no finite value in 7 of") as raised:
        monte_carlo(Other(formula, ("good", "worse")), seed=1, trials=trials)
    assert "good" not in str(raised.value)


def test_clause8_passes_fails_and_abstains() -> None:
    sure = monte_carlo(Bent(0.0), seed=1, tolerance_fraction=0.2)
    assert clause8(3.0, 2.0, Z, sure).passed is True
    wrong = clause8(3.2, 2.0, Z, sure)
    assert wrong.passed is False
    assert wrong.d_low == pytest.approx(0.2, abs=1e-6)
    assert wrong.tolerance == pytest.approx(0.05)
    unsure = monte_carlo(Bent(0.0, control=False), seed=1, trials=20_000)
    assert clause8(3.0, 2.0, Z, unsure).passed is None
    # So far off that even these few trials can tell.
    assert clause8(8.0, 2.0, Z, unsure).passed is False
    # What is far below the tolerance passes before its fifth is reached; a run goes on to that.
    short = monte_carlo(Bent(0.0, control=False), seed=1, trials=500_000)
    early = clause8(3.0, 2.0, Z, short)
    assert (early.passed, early.settled) == (True, False)
    # A difference within two standard errors of the tolerance is still open.
    near = early.tolerance - float(short.se_low[0])
    assert clause8(3.0 + near, 2.0, Z, short).passed is None


# Monte Carlo results against analytic ones; its own standard uncertainty.


@pytest.mark.parametrize("control", [False, True])
@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_bent_normal(bend: float, control: bool) -> None:
    model = Bent(bend, control)
    result = monte_carlo(model, seed=8, trials=400_000)
    for name, exact in model.exact.items():
        # The ends are exact up to the far branch of the parabola, beyond 10 u.
        error = getattr(result, name)[0] - exact
        assert abs(error) <= 4 * getattr(result, f"se_{name}")[0] + 1e-8, name


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


def scatter_as_stated(model: Bent, results: list[MonteCarloResult], of_se: float) -> None:
    """Mean squared error over mean se^2: chi-square of the seeds, less what se itself scatters."""
    seeds = len(results)
    for name, exact in model.exact.items():
        error = np.array([getattr(r, name)[0] for r in results]) - exact
        se = np.array([getattr(r, f"se_{name}")[0] for r in results])
        four_sigma = 4.0 * np.sqrt((2.0 + of_se) / seeds)
        assert abs(np.mean(error**2) / np.mean(se**2) - 1.0) < four_sigma + 0.1, name
        assert abs(error.mean()) < 4.0 * np.sqrt(np.mean(se**2) / seeds) + 1e-12, name


@pytest.mark.parametrize("trials", [8_003, None])
def test_few_trials_of_a_smooth_model(trials: int | None) -> None:
    """Unbiased, with the scatter stated, over 200 seeds; se^2 of ten blocks has 2/9 itself."""
    seeds, model = 200, Smooth(0.05)
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
