"""Sums of chi-squared variables: against one of them, a closed form, and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats.uncertain_variance import mean_square_tails, sum_tails, uncertain_variance

P = [1e-6, 1e-3, 0.05, 0.5, 0.95, 0.999, 1 - 1e-6]


@pytest.mark.parametrize(("dof", "error"), [(1, 0.13), (2, 0.06), (5, 0.02), (50, 5e-4)])
def test_equal_ones_are_one_chi_squared(dof: int, error: float) -> None:
    """The formula's own error is least for many degrees of freedom: 0.3/dof of a tail."""
    x = np.asarray(stats.chi2.ppf(P, dof), np.float64)
    high, low = sum_tails(np.array([1.0]), dof, x)
    assert high == pytest.approx(stats.chi2.sf(x, dof), rel=error)
    assert low == pytest.approx(stats.chi2.cdf(x, dof), rel=error)
    several, _ = sum_tails(np.full(dof, 3.0), 1.0, 3.0 * x)
    assert several == pytest.approx(high, rel=1e-9)


def test_two_sizes_against_the_closed_form() -> None:
    """Of two degrees of freedom each they are exponentials: a exp(-x/2a)/(a - b) - ..."""
    a, b, x = 3.0, 1.0, np.array([0.5, 4.0, 15.0, 40.0])
    exact = (a * np.exp(-x / (2 * a)) - b * np.exp(-x / (2 * b))) / (a - b)
    high, low = sum_tails(np.array([a, b, 0.0]), 2.0, x)
    assert high == pytest.approx(exact, rel=0.04)
    assert high + low == pytest.approx(np.ones(4))


def test_many_sizes_against_draws() -> None:
    sizes, dof, draws = np.array([9.0, 4.0, *[0.5] * 20]), 3, 200_000
    total = np.random.default_rng(1).chisquare(dof, (draws, len(sizes))) @ sizes
    x = np.quantile(total, [0.001, 0.02, 0.3, 0.7, 0.98, 0.999])
    high, low = sum_tails(sizes, dof, x)
    beyond = np.array([(total > end).mean() for end in x])
    for tail, drawn in ((high, beyond), (low, 1 - beyond)):
        error = 4 * np.sqrt(drawn * (1 - drawn) / draws)
        assert (np.abs(tail - drawn) < error + 0.02 * drawn).all()


def test_near_the_mean_and_at_nothing() -> None:
    """At its mean the formula is 0/0: beside it tails go on without a step, to 1e-5."""
    sizes, dof = np.array([2.0, 1.0, 1.0]), 4.0
    x = 16.0 * (1 + np.linspace(-2e-3, 2e-3, 41))
    high, _ = sum_tails(sizes, dof, x)
    steps = np.diff(high)
    assert (steps < 0).all()
    assert steps.min() == pytest.approx(steps.max(), abs=1e-5)
    high, low = sum_tails(sizes, dof, np.array([0.0, 1e300, np.inf]))
    assert high.tolist() == [1.0, 0.0, 0.0]
    assert low.tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("nu", [4.0, 12.0])
def test_a_mean_square_against_one_of_few_readings_is_fishers(nu: float) -> None:
    """A hundredth for the nodes of the variance."""
    variance = uncertain_variance(np.array([[2.5]]), np.array([nu]))
    high, low = mean_square_tails(6.0, np.full(6, 0.7), 5.0, variance)
    assert high == pytest.approx(stats.f.sf(6.0 / 2.5, 30, nu), rel=0.01)
    assert low == pytest.approx(stats.f.cdf(6.0 / 2.5, 30, nu), rel=0.01)


def test_scatter_where_none_is_expected() -> None:
    variance = uncertain_variance(np.array([[0.0]]), np.array([np.inf]))
    # Sums of probabilities, whose last digit is the processor's matter.
    tails = mean_square_tails(1.0, np.ones(3), 4.0, variance)
    assert tails == pytest.approx((0.0, 1.0), abs=1e-14)
