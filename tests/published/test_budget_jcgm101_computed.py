"""Figures of JCGM 101:2008, clause 9, calculated here by other means than a Monte Carlo of ours.

They are those that test_budget_jcgm101.py gives from memory of the document: what is compared is
the calculation, with the figure as it is remembered and with the budget. Half a unit of the last
digit, or what the document's own sample of so many trials may be off. Those of 9.5 were drawn with
numpy alone (2e6 trials): 838 nm, u 36 nm, the ends within two standard errors of both samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from budget_examples import evaluated
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chndtr, chndtrix, ndtr
from test_budget_jcgm101 import MASS, additive, loss


def sum_of_rectangles(x: float, half_widths: list[float]) -> float:
    """P(sum <= x) = sum over signs of prod(s) (x + s . a)_+^n / (n! prod 2 a_i)."""
    n = len(half_widths)
    terms = [
        math.prod(signs) * max(x + float(np.dot(signs, half_widths)), 0.0) ** n
        for signs in product((-1, 1), repeat=n)
    ]
    return math.fsum(terms) / (math.factorial(n) * math.prod(2.0 * a for a in half_widths))


def test_rectangles_of_unequal_widths() -> None:
    """9.2.4: u = sqrt(103) = 10.1 and k u = 19.9, the end of the distribution itself 17.0."""
    widths = [math.sqrt(3.0)] * 3 + [10.0 * math.sqrt(3.0)]
    end = float(brentq(lambda x: sum_of_rectangles(x, widths) - 0.975, 10.0, 22.0, xtol=1e-12))
    assert end == pytest.approx(17.0, abs=0.05)
    assert 1.959964 * math.sqrt(103.0) == pytest.approx(19.9, abs=0.05)
    kinds = [f"u: {u}, distribution: rectangular" for u in (1, 1, 1, 10)]
    run = evaluated(additive(*kinds), trials=1_000_000).run
    assert run.high[0] == pytest.approx(end, abs=4 * run.se_high[0])
    assert run.low[0] == pytest.approx(-end, abs=4 * run.se_low[0])


def shortest(quantile: Callable[[float], float], probability: float) -> tuple[float, float]:
    """The shortest interval from `quantile`, by the probability below its lower end."""
    found = minimize_scalar(
        lambda p: quantile(p + probability) - quantile(p),
        bounds=(1e-9, 1.0 - probability - 1e-9),
        method="bounded",
        options={"xatol": 1e-7},
    )
    return quantile(float(found.x)), quantile(float(found.x) + probability)


def mass_distribution() -> tuple[float, Callable[[float], float]]:
    """u and the distribution function of the mass of 9.3, by conditioning on the densities.

    dm = A (1 + B C) - m with A normal, B = rho_a - 1.2 rectangular in -+0.1, C = 1/rho_w - 1/rho_r.
    E B = 0, so that V = V(A) + E(A^2) V(B) E(C^2); given B and C dm is normal. Gauss-Legendre.
    """
    sigma, m = math.hypot(0.050, 0.020), 100001.234
    nodes, weights = np.polynomial.legendre.leggauss(40)
    b = 0.1 * nodes[:, None, None]
    c = 1.0 / (8000.0 + 1000.0 * nodes[:, None]) - 1.0 / (8000.0 + 50.0 * nodes)
    share = weights[:, None, None] * weights[:, None] * weights / 8.0
    inverse_w, inverse_r = math.log(9.0 / 7.0) / 2000.0, math.log(8050.0 / 7950.0) / 100.0
    square = 1.0 / (7000.0 * 9000.0) + 1.0 / (7950.0 * 8050.0) - 2.0 * inverse_w * inverse_r
    u = math.sqrt(sigma**2 + (m**2 + sigma**2) * 0.01 / 3.0 * square)
    centre, width = 1.234 + m * b * c, sigma * (1.0 + b * c)

    def below(y: float) -> float:
        return float(np.sum(share * ndtr((y - centre) / width)))

    return u, below


def test_mass_calibration() -> None:
    """9.3: u = 0.0754 mg and the shortest interval [1.0834, 1.3825] mg of 7.2e5 trials.

    Standard errors of theirs: u/sqrt(2 M) = 6e-5 mg of u; of the ends, whose place is a flat
    minimum, 1e-3 mg, and of the width 5e-4 (twelve plain samples of as many trials).
    """
    u, below = mass_distribution()

    def quantile(p: float) -> float:
        return float(brentq(lambda y: below(y) - p, 0.5, 2.0, xtol=1e-10))

    low, high = shortest(quantile, 0.95)
    assert u == pytest.approx(0.0754, abs=5e-5 + 2 * 6e-5)
    assert high - low == pytest.approx(1.3825 - 1.0834, abs=1e-4 + 2 * 5e-4)
    assert low == pytest.approx(1.0834, abs=5e-5 + 2 * 1e-3)
    run = evaluated(MASS, trials=1_000_000).run
    assert run.u[0] == pytest.approx(u, abs=4 * run.se_u[0])
    assert run.low[0] == pytest.approx(quantile(0.025), abs=4 * run.se_low[0])
    assert run.high[0] == pytest.approx(quantile(0.975), abs=4 * run.se_high[0])
    width = run.shortest_high[0] - run.shortest_low[0]
    assert width == pytest.approx(high - low, abs=4 * np.hypot(run.se_low[0], run.se_high[0]))


@pytest.mark.parametrize(
    ("x1", "printed"), [(0.000, (0, 150)), (0.010, (0, 367)), (0.050, (1590, 3543))]
)
def test_comparison_loss(x1: float, printed: tuple[int, int]) -> None:
    """9.4, Table 7: (x1^2 + x2^2)/s^2 is non-central chi-squared of two degrees of freedom.

    For x1 = 0 exponential of mean 50: the shortest interval is [0, 50 ln 20] = [0, 149.8]. The
    printed ends are of a sample of 1e6 trials: those at 0 and beside it are sure to 1; those of
    x1 = 0.05, in a flat minimum, have standard errors of 4.6, their width of 1.5 (twelve plain
    samples of as many trials).
    """
    s = 0.005
    away = (x1 / s) ** 2

    def quantile(p: float) -> float:
        return 1e6 * s * s * float(chndtrix(p, 2.0, away))

    low, high = shortest(quantile, 0.95)
    assert float(chndtr(high / (1e6 * s * s), 2.0, away)) > 0.95
    if x1 == 0.0:
        assert high == pytest.approx(50.0 * math.log(20.0), abs=0.01)
    end, width = (4.6, 1.5) if low > 1.0 else (0.0, 0.0)
    assert high - low == pytest.approx(printed[1] - printed[0], abs=1.0 + 2 * width)
    assert low == pytest.approx(printed[0], abs=0.5 + 2 * end)
    run = evaluated(loss(x1, 0.0), trials=1_000_000).run
    assert run.low[0] == pytest.approx(quantile(0.025), abs=4 * run.se_low[0])
    assert run.high[0] == pytest.approx(quantile(0.975), abs=4 * run.se_high[0])
