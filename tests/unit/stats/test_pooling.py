"""Averages of ordered values and shortest intervals; ends of outputs that take few values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import ndtr, ndtri

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo

FloatArray = NDArray[np.float64]


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


class Chances:
    """Outputs that are 0 with the probabilities given, 1 otherwise; their control is nil."""

    def __init__(self, *failing: float) -> None:
        self.failing = np.array(failing)
        self.names = tuple(f"p{i}" for i in range(len(failing)))
        self.linear_mean = np.ones(len(failing))
        self.linear_variance = np.zeros(len(failing))

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        values = (rng.random((len(self.failing), m)) >= self.failing[:, None]).astype(float)
        return Draws(values=values, linear=np.ones_like(values))


def run(*failing: float, trials: int | None = 200_000) -> MonteCarloResult:
    return monte_carlo(Chances(*failing), seed=3, trials=trials)


@pytest.mark.parametrize(
    ("failing", "low", "shortest_low"),
    [(0.0, 1.0, 1.0), (2e-4, 1.0, 1.0), (0.022, 1.0, 1.0), (0.03, 0.0, 1.0), (0.4, 0.0, 0.0)],
)
def test_the_ends_are_values_of_the_output(failing: float, low: float, shortest_low: float) -> None:
    """0.022 and 0.03 are seven standard errors from 0.025 at 200 000 trials, and 0.4 from 0.95."""
    found = run(failing)
    assert (found.low[0], found.high[0]) == (low, 1.0)
    assert (found.shortest_low[0], found.shortest_high[0]) == (shortest_low, 1.0)
    # Four standard errors of a share.
    assert abs(found.mean[0] - (1 - failing)) <= 4 * np.sqrt(failing * (1 - failing) / 200_000)


def test_ends_are_those_of_the_ordered_trials() -> None:
    """Sorted by numpy: the smallest value with a share of (1 - p)/2 or more at or below it."""

    class Counts(Chances):
        def draw(self, rng: np.random.Generator, m: int) -> Draws:
            values: FloatArray = rng.binomial(12, 0.3, (1, m)).astype(float)
            return Draws(values=values, linear=np.ones_like(values))

    found = monte_carlo(Counts(0.0), seed=5, trials=100_000)
    samples = found.samples[0]
    for end, share in ((found.low[0], 0.025), (found.high[0], 0.975)):
        assert end == np.quantile(samples, share, method="inverted_cdf")
    width = found.shortest_high[0] - found.shortest_low[0]
    widths = [
        b - a
        for a in range(13)
        for b in range(a, 13)
        if np.mean((samples >= a) & (samples <= b)) >= 0.95
    ]
    assert width == min(widths)


def test_an_adaptive_count_does_not_wait_for_ends_that_jump() -> None:
    found = run(0.0225, trials=None)
    assert found.converged
    assert found.trials < 1_000_000
    assert found.se_low[0] == 0
