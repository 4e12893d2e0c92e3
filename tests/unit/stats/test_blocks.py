"""Ordered values of blocks against full sorts and exact sums; scratch arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import ndtr, ndtri
from trial_models import Bent

from mtu_cli.stats.blocks import BlockPlan, BlockSummariser, Draws
from mtu_cli.stats.monte_carlo import monte_carlo

FloatArray = NDArray[np.float64]


@pytest.mark.parametrize("m", [2000, 4096, 8192])
def test_weights_remove_the_bias_of_ordered_values(m: int) -> None:
    """Exponential: E y_(j) from above = sum of 1/i for i = j to m, exactly; Q = -ln a."""
    plan = BlockPlan(0.95, m, None)
    weights, (middle,) = plan.weights(m), np.flatnonzero(np.isclose(plan.shares, 0.025))
    expected = np.cumsum(1.0 / np.arange(m, 0, -1))[::-1][: len(weights)]
    left = (expected @ weights + np.log(plan.shares))[middle]
    ranks = np.arange(1, len(weights) + 1)
    uncorrected = np.interp(0.025 * (m + 1), ranks, expected) + np.log(0.025)
    assert abs(left) < 0.05 * abs(uncorrected)


@pytest.mark.parametrize("m", [2000, 2001])
def test_quantiles_of_many_short_blocks_are_unbiased(m: int) -> None:
    """A block longer by a trial is read at the same probabilities."""
    model = Bent(control=False)
    plan = BlockPlan(0.95, 2000, 1000)
    summariser = BlockSummariser(model, plan)
    rng = np.random.default_rng(0)
    draws = [summariser.summarise(model.draw(rng, m)).statistics[2:, 0] for _ in range(1000)]
    # Ranks below eight have no stencil that would remove their bias.
    known = plan.shares > 8 / 2001
    exact = np.concatenate([side * 2.0 * ndtri(plan.shares) for side in (1, -1)]) + 3.0
    error = (np.mean(draws, axis=0) - exact)[np.tile(known, 2)]
    assert np.all(np.abs(error) < 5 * np.std(draws, axis=0)[np.tile(known, 2)] / np.sqrt(1000))


@pytest.mark.parametrize("m", [200, 201, 1000, 8192])
@pytest.mark.parametrize("f", [np.exp, np.round, np.zeros_like])
def test_quantiles_are_those_of_a_full_sort(f: Callable[[FloatArray], FloatArray], m: int) -> None:
    """Of skew values, of few values, of equal ones; a block too short for two tails is sorted."""
    block = f(np.random.default_rng(1).standard_normal((1, m)))
    before = block.copy()
    plan = BlockPlan(0.5 if m == 201 else 0.95, m, None)
    found = BlockSummariser(Bent(control=False), plan).summarise(Draws(values=block)).statistics
    ordered, weights = np.sort(block[0]), plan.weights(m)
    lower, upper = np.split(found[2:, 0], 2)
    assert lower == pytest.approx(ordered[: len(weights)] @ weights, rel=1e-12, abs=1e-12)
    assert upper == pytest.approx(ordered[::-1][: len(weights)] @ weights, rel=1e-12, abs=1e-12)
    assert np.array_equal(block, before)


# Shortest intervals from averages of ordered values.


class Curved:
    """y = f(z) with the control 1 + slope z, as a budget has it about z = 0."""

    names = ("y",)
    linear_mean = np.ones(1)

    def __init__(self, f: Callable[[FloatArray], FloatArray], slope: float) -> None:
        self.f, self.slope = f, slope

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        z = rng.standard_normal((1, m))
        return Draws(values=self.f(z), linear=1.0 + self.slope * z)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        return np.asarray(self.slope * ndtri(probability)[np.newaxis])


def least_width(quantile: Callable[[FloatArray], FloatArray], first: float) -> float:
    """Of the 95 % intervals whose lower end is at the probability `first` or above."""
    a = np.linspace(first, 0.05, 200_001)[:-1]
    return float(np.min(quantile(a + 0.95) - quantile(a)))


@pytest.mark.parametrize("sigma", [0.5, 2.0, 5.0])
def test_shortest_interval_of_a_lognormal_beside_its_first_order_form(sigma: float) -> None:
    """The form has the slope sigma, the output's quantiles sigma Q: far apart from rank to rank.

    At equal densities of both ends, z_a + z_b = -2 sigma, or at the block's first ordered value.
    """
    result = monte_carlo(Curved(lambda z: np.exp(sigma * z), sigma), seed=8, trials=1_000_000)
    exact = least_width(lambda p: np.exp(sigma * ndtri(p)), 1.0 / 8193)
    width = result.shortest_high[0] - result.shortest_low[0]
    # The bias of the first ordered values, of a tenth of them or so, has no stencil to remove it.
    first = 0.1 * float(np.exp(sigma * ndtri(1.0 / 8193))) if sigma >= 1.0 else 0.0
    assert width == pytest.approx(exact, abs=first + 4 * result.se_high[0])
    if sigma == 0.5:
        z = optimize.brentq(lambda z: ndtr(z) - ndtr(-z - 2 * sigma) - 0.95, 1.0, 3.0)
        assert exact == pytest.approx(np.exp(sigma * z) - np.exp(sigma * (-z - 2 * sigma)))
    assert width < 0.96 * (result.high[0] - result.low[0])
