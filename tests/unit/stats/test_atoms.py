"""Interval ends of outputs that take few values, against the ordered trials themselves."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo


class Chances:
    """Outputs that are 0 with the probabilities given, 1 otherwise; their control is nil."""

    def __init__(self, *failing: float) -> None:
        self.failing = np.array(failing)
        self.names = tuple(f"p{i}" for i in range(len(failing)))
        self.linear_mean = np.ones(len(failing))
        self.linear_variance = np.zeros(len(failing))

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        values = (rng.random((len(self.failing), m)) >= self.failing[:, None]).astype(float)
        return Draws(values=values, linear=np.ones_like(values), linear_u=None)


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
            return Draws(values=values, linear=np.ones_like(values), linear_u=None)

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
