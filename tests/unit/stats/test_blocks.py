"""Ordered values of blocks against full sorts and exact sums; scratch arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri
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


class Curved:
    """y = exp(sigma z) with the control 1 + sigma z, as a budget has it about z = 0."""

    names, linear_mean = ("y",), np.ones(1)

    def __init__(self, sigma: float) -> None:
        self.sigma = sigma

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        z = self.sigma * rng.standard_normal((1, m))
        return Draws(values=np.exp(z), linear=1.0 + z)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        return np.asarray(self.sigma * ndtri(probability)[np.newaxis])


@pytest.mark.parametrize("sigma", [0.5, 2.0])
def test_shortest_interval_of_a_lognormal_beside_its_first_order_form(sigma: float) -> None:
    """The form has the slope sigma, the output's quantiles sigma Q: far apart from rank to rank."""
    result = monte_carlo(Curved(sigma), seed=8, trials=1_000_000)
    first = 1.0 / 8193
    a = np.linspace(first, 0.05, 200_001)[:-1]
    exact = np.min(np.exp(sigma * ndtri(a + 0.95)) - np.exp(sigma * ndtri(a)))
    width = result.shortest_high[0] - result.shortest_low[0]
    # The bias of the first ordered values, of a tenth of them or so, has no stencil to remove it.
    bias = 0.1 * float(np.exp(sigma * ndtri(first))) if sigma >= 1.0 else 0.0
    assert width == pytest.approx(exact, abs=bias + 4 * result.se_high[0])
    assert width < 0.96 * (result.high[0] - result.low[0])
