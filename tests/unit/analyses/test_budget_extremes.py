"""Budgets at the ends of the number range, and what a copula with a t draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import codes, evaluated, single

from mtu_cli.findings import InputError
from mtu_cli.stats.distributions import Distribution

ONE = "equation: {equation}\ninputs:\n  a: {{value: {value}, u: {u}}}\n"


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("exponent", [-100, 100])
def test_outputs_whose_squares_leave_the_range(exponent: int) -> None:
    """y = a^2: as with a = 1, but for the power of ten, in every figure of the budget."""
    plain = evaluated(ONE.format(equation="a*a", value="1.0", u="0.01"))
    text = ONE.format(equation="a*a", value=f"1.0e{exponent}", u=f"1.0e{exponent - 2}")
    result = evaluated(text)
    scale = 10.0 ** (2 * exponent)
    first, expected = single(result).first, single(plain).first
    for name in ("value", "u", "second_value", "second_u"):
        assert getattr(first, name) == pytest.approx(scale * getattr(expected, name), rel=1e-9)
    for name in ("mean", "u", "low", "high", "shortest_low", "shortest_high"):
        assert getattr(result.run, name)[0] == pytest.approx(
            scale * getattr(plain.run, name)[0], rel=1e-9
        )
    assert result.correlation[0, 0] == 1.0
    assert "no-uncertainty" not in codes(result)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_an_overflow_beside_finite_estimates_is_one_message() -> None:
    """exp(700) is finite, exp(710) is not."""
    with pytest.raises(InputError, match=r"b.yaml:3: equation: 'y' has no finite value in"):
        evaluated(ONE.format(equation="exp(a)", value="700.0", u="50.0"))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_without_a_standard_error_nothing_has_converged() -> None:
    """exp of a normal of sd 100: the fourth powers of the trials overflow."""
    result = evaluated(ONE.format(equation="exp(a)", value="0.0", u="100.0"), trials=100_000)
    assert not math.isfinite(result.run.se_u[0])
    assert not result.converged
    assert {"not-converged", "heavy-tails"} <= codes(result)


def test_a_ratio_whose_divisor_may_be_0_has_no_u() -> None:
    """No trials settle what does not exist; one that stays away from 0 has one."""
    text = (
        "equation: a/b\nquantity: {name: r, unit: '1'}\n"
        "inputs:\n  a: {value: 1, u: 0.1}\n  b: {value: 1, u: U}\n"
    )
    found = evaluated(text.replace("U", "0.4"), trials=200_000)
    assert "heavy-tails" in codes(found)
    assert "heavy-tails" not in codes(evaluated(text.replace("U", "0.1"), trials=200_000))
    # A u of 0, and few trials, say nothing of it.
    assert "heavy-tails" not in codes(evaluated(text.replace("U", "0.4"), trials=2000))


@pytest.mark.parametrize("dof", [3, 5, 20])
def test_a_t_in_a_copula_has_the_coefficient_that_the_warning_says(dof: int) -> None:
    """The factor by quadrature over the chi, and in what is drawn."""
    s = np.linspace(1e-6, 12.0, 400_001)
    density = s ** (dof - 1) * np.exp(-0.5 * dof * s * s)
    mean, square = (float(np.sum(density * s**-n) / np.sum(density)) for n in (1, 2))
    factor = mean / math.sqrt(square)
    item = Distribution(kind="normal", u=1.0, dof=float(dof))
    assert item.correlated_share == pytest.approx(factor, rel=1e-3 if dof == 3 else 1e-6)
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
    assert f"(a {factor:.3g}; 1 for others)" in weaker


CANCELLING = """
    equations: {a: (3*x)/x, b: x*y/x - y, c: x + z - z - x, d: 2*y*x/x, e: f*(1 + g)}
    inputs:
      x: {value: 1.1, u: 0.05}
      y: {value: 7.3, u: 0.05}
      z: 1.0e9
      f: {value: 9192631770, u: 1.0e-6}
      g: {value: 0, u: 1.0e-16}
"""


def test_rounding_is_no_variance() -> None:
    """What cancels has no u, by first order and by trials, and does not fail clause 8; an
    uncertainty near the spacing of numbers is one.
    """
    result = evaluated(CANCELLING)
    a, b, c, d, e = result.outputs
    for output in (a, b, c):
        assert output.first.u == output.first.second_u == output.of_run("u") == 0.0
        assert output.validation.passed
    assert a.first.value == a.mean == 3.0
    assert d.first.u == pytest.approx(0.1)
    assert e.first.u == pytest.approx(math.hypot(1e-6, 9.192631770e-7))
    assert codes(evaluated(CANCELLING.replace(", e: f*(1 + g)", ""))) == {"unused"}
