"""What the trials of a budget draw, also at the ends of the number range."""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import codes, evaluated

from mtu_cli.stats.coverage import coverage_factor


def test_correlated_inputs_of_equal_degrees_of_freedom_are_a_multivariate_t() -> None:
    """The coefficient is as stated; a - b is a t of the same degrees of freedom, and each input.

    Scales of their own would leave 0.9 times the coefficient, and tails of a - b between t and
    normal.
    """
    text = (
        "equations: {a: x, b: y, d: x - y}\n"
        "inputs: {x: {value: 0, u: 1, dof: 6}, y: {value: 0, u: 2, dof: 6}}\n"
        "correlations: [[x, y, 0.7]]\n"
    )
    result = evaluated(text, trials=400_000)
    assert codes(result) == set()
    V = result.run.covariance
    # r of a sample of t with 6 degrees of freedom: (1 - r^2) sqrt((1 + kappa/3)/M), kappa = 3.
    error = (1 - 0.7**2) * math.sqrt(2 / 400_000)
    assert V[0, 1] / math.sqrt(V[0, 0] * V[1, 1]) == pytest.approx(0.7, abs=4 * error)
    for i, u in enumerate((1.0, 2.0, math.sqrt(1 + 4 - 2 * 0.7 * 2))):
        assert result.run.high[i] == pytest.approx(
            coverage_factor(0.95, 6.0) * u, abs=4 * result.run.se_high[i] + 1e-9
        )


@pytest.mark.parametrize("dof", [3, 5, 20])
def test_a_t_in_a_copula_has_a_smaller_coefficient(dof: int) -> None:
    """The factor by quadrature over the chi."""
    s = np.linspace(1e-6, 12.0, 400_001)
    density = s ** (dof - 1) * np.exp(-0.5 * dof * s * s)
    mean, square = (float(np.sum(density * s**-n) / np.sum(density)) for n in (1, 2))
    factor = mean / math.sqrt(square)
    result = evaluated(
        "equations: {p: a, q: b, s: c}\n"
        f"inputs:\n  a: {{value: 0, u: 1, dof: {dof}}}\n  b: {{value: 0, u: 1}}\n"
        "  c: {value: 0, half_width: 1, distribution: rectangular}\n"
        "correlations: [[a, b, 0.6], [b, c, 0.1]]\n",
        trials=200_000,
    )
    V = result.run.covariance
    if dof > 4:
        r = V[0, 1] / math.sqrt(V[0, 0] * V[1, 1])
        assert r == pytest.approx(0.6 * factor, abs=0.01)
    weaker = next(x.facts["weaker"] for x in result.warnings if x.code == "correlated-inputs")
    assert "coefficients of the trials smaller" in weaker
