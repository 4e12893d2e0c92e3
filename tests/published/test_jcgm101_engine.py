"""Printed results of JCGM 101:2008, clause 9, by the bare Monte Carlo engine.

Tolerances: half a unit of the last printed digit and three standard errors of ours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.validation import clause8

FloatArray = NDArray[np.float64]
K95 = coverage_factor(0.95)


class Formula:
    """One output without a first-order form."""

    names = ("y",)
    linear_mean = None

    def __init__(self, formula: Callable[[np.random.Generator, int], FloatArray]) -> None:
        self.formula = formula

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        return Draws(values=self.formula(rng, m)[np.newaxis])


def normals(rng: np.random.Generator, m: int) -> FloatArray:
    return np.asarray(rng.standard_normal((4, m)).sum(axis=0))


def rectangles(*u: float) -> Callable[[np.random.Generator, int], FloatArray]:
    half = np.sqrt(3.0) * np.array(u)
    return lambda rng, m: np.asarray(half @ rng.uniform(-1.0, 1.0, (4, m)))


@pytest.mark.parametrize(
    ("formula", "u", "end", "digit", "passed"),
    [
        (normals, 2.00, 3.92, 0.005, True),  # Table 2
        (rectangles(1.0, 1.0, 1.0, 1.0), 2.00, 3.88, 0.005, True),  # Table 3
        (rectangles(1.0, 1.0, 1.0, 10.0), 10.1, 17.0, 0.05, False),  # Table 4
    ],
)
def test_additive_model(
    formula: Callable[[np.random.Generator, int], FloatArray],
    u: float,
    end: float,
    digit: float,
    passed: bool,
) -> None:
    """9.2.2 to 9.2.4: y = 0.00, u(y) and the 95 % interval; clause 8 as printed there."""
    result = monte_carlo(Formula(formula), seed=101, trials=2_000_000)
    assert result.mean[0] == pytest.approx(0.0, abs=3 * result.se_mean[0])
    assert result.u[0] == pytest.approx(u, abs=digit + 3 * result.se_u[0])
    assert result.low[0] == pytest.approx(-end, abs=digit + 3 * result.se_low[0])
    assert result.high[0] == pytest.approx(end, abs=digit + 3 * result.se_high[0])
    first_order = 2.0 if u == 2.0 else np.sqrt(103.0)
    assert clause8(0.0, first_order, K95, result).passed is passed


def test_four_rectangles_analytically() -> None:
    """9.2.3.3: the end is 2 sqrt(3) (2 - (3/5)^(1/4)) = 3.88."""
    result = monte_carlo(Formula(rectangles(1, 1, 1, 1)), seed=7, trials=4_000_000)
    exact = 2.0 * np.sqrt(3.0) * (2.0 - 0.6**0.25)
    assert result.high[0] == pytest.approx(exact, abs=4 * result.se_high[0])
    assert result.low[0] == pytest.approx(-exact, abs=4 * result.se_low[0])


def test_clause8_differences_of_ten_times_wider_rectangle() -> None:
    """Table 4: [-19.9, 19.9] against [-17.0, 17.0], d = 2.9 above delta = 0.5."""
    result = monte_carlo(Formula(rectangles(1, 1, 1, 10)), seed=3, tolerance_fraction=0.2)
    outcome = clause8(0.0, np.sqrt(103.0), K95, result)
    assert outcome.tolerance == pytest.approx(0.5)
    assert outcome.d_low == pytest.approx(2.9, abs=0.05 + 3 * result.se_low[0])
    assert outcome.d_high == pytest.approx(2.9, abs=0.05 + 3 * result.se_high[0])
    assert result.converged


def mass(rng: np.random.Generator, m: int) -> FloatArray:
    reference = rng.normal(100000.0, 0.050, m) + rng.normal(1.234, 0.020, m)
    air = rng.uniform(1.10, 1.30, m)
    weight, standard = rng.uniform(7000.0, 9000.0, m), rng.uniform(7950.0, 8050.0, m)
    return reference * (1.0 + (air - 1.2) * (1.0 / weight - 1.0 / standard)) - 100000.0


def test_mass_calibration() -> None:
    """9.3, by Monte Carlo: 1.2341 mg, 0.0754 mg, shortest [1.0834, 1.3825] mg."""
    result = monte_carlo(Formula(mass), seed=93, trials=2_000_000)
    assert result.mean[0] == pytest.approx(1.2341, abs=0.0001 + 3 * result.se_mean[0])
    assert result.u[0] == pytest.approx(0.0754, abs=0.00005 + 3 * result.se_u[0])
    # Their ends come from 7e5 trials, and the ends of a shortest interval scatter widely.
    assert result.shortest_low[0] == pytest.approx(1.0834, abs=0.003)
    assert result.shortest_high[0] == pytest.approx(1.3825, abs=0.003)
    assert result.shortest_high[0] - result.shortest_low[0] == pytest.approx(0.2991, abs=0.0005)


@pytest.mark.parametrize(
    ("x1", "y", "u", "low", "high"),
    [(0.000, 50, 50, 0, 150), (0.010, 150, 112, 0, 367), (0.050, 2551, 502, 1590, 3543)],
)
def test_comparison_loss(x1: float, y: float, u: float, low: float, high: float) -> None:
    """9.4.2, uncorrelated inputs, in 1e-6: Y = X1^2 + X2^2 with u(x_i) = 0.005."""

    def loss(rng: np.random.Generator, m: int) -> FloatArray:
        x = rng.normal(0.0, 0.005, (2, m))
        x[0] += x1
        return np.asarray(1e6 * (x**2).sum(axis=0))

    result = monte_carlo(Formula(loss), seed=94, trials=1_000_000)
    # 2551 is printed for an exact expectation of 2550: their sample, not the distribution.
    assert result.mean[0] == pytest.approx(y, abs=1.0 + 3 * result.se_mean[0])
    assert result.u[0] == pytest.approx(u, abs=0.5 + 3 * result.se_u[0])
    assert result.shortest_low[0] == pytest.approx(low, abs=0.5 + 0.03 * u)
    assert result.shortest_high[0] == pytest.approx(high, abs=0.5 + 0.03 * u)
