"""Shortest intervals from averages of ordered values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import ndtr, ndtri

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.monte_carlo import monte_carlo

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
