"""Budgets: first order, correlation, Monte Carlo.

Oracles: closed forms by hand, plain simulations with another generator, and the engine's own
standard errors (four of them).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from budget_examples import CORRELATED, codes, evaluated, single

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.findings import InputError


def test_three_readings_beside_others() -> None:
    """A t of 2 degrees of freedom among normals: no u, an interval by plain simulation."""
    text = "equation: x + y\ninputs: {x: {readings: [1, 2, 3]}, y: {value: 0, u: 1}}\n"
    result = evaluated(text)
    assert math.isnan(result.run.u[0])
    rng = np.random.default_rng(5)
    plain = 2 + rng.standard_t(2, 2_000_000) / math.sqrt(3) + rng.standard_normal(2_000_000)
    low, high = np.quantile(plain, [0.025, 0.975])
    assert result.run.low[0] == pytest.approx(low, abs=4 * result.run.se_low[0] + 0.01)
    assert result.run.high[0] == pytest.approx(high, abs=4 * result.run.se_high[0] + 0.01)


@pytest.mark.parametrize(
    ("equation", "exact"),
    [
        ("abs(x)", math.sqrt(1 - 2 / math.pi)),
        ("step(x)", 0.5),
        ("sqrt(x**2 + y**2)", math.sqrt(2 - math.pi / 2)),
    ],
)
def test_without_derivative_the_monte_carlo_stands_alone(equation: str, exact: float) -> None:
    inputs = ", ".join(f"{name}: {{value: 0, u: 1}}" for name in "xy" if name in equation)
    result = evaluated(f"equation: {equation}\ninputs: {{{inputs}}}\n")
    assert math.isnan(single(result).first.u)
    assert math.isnan(single(result).expanded)
    assert "not-differentiable" in codes(result)
    assert result.run.u[0] == pytest.approx(exact, abs=4 * result.run.se_u[0])


def test_shares_and_covariance() -> None:
    """By hand: c = (1, 2), u = (1, 0.5), r = 0.7: shares 1.7/3.4 each; two outputs C V C'."""
    assert single(evaluated(CORRELATED)).first.share == pytest.approx([0.5, 0.5])
    result = evaluated(CORRELATED.replace("equation: a + 2*b", "equations: {s: a + b, d: a - b}"))
    V = np.array([[1.0, 0.35], [0.35, 0.25]])
    C = np.array([[1.0, 1.0], [1.0, -1.0]])
    assert result.covariance == pytest.approx(C @ V @ C.T)
    assert result.run.covariance == pytest.approx(C @ V @ C.T, abs=0.02)
    own = result.covariance
    r = own[0, 1] / math.sqrt(own[0, 0] * own[1, 1])
    assert result.correlation[0, 1] == pytest.approx(r)


def copula(kind: str, r: float) -> BudgetResult:
    return evaluated(
        "equations: {s: a + b, d: a - b}\n"
        f"inputs:\n  a: {{value: 0, u: 1, distribution: {kind}}}\n"
        f"  b: {{value: 0, u: 2}}\ncorrelations: [[a, b, {r}]]\n",
        trials=200_000,
    )


@pytest.mark.parametrize("kind", ["rectangular", "arcsine"])
def test_correlated_inputs_that_are_not_normal(kind: str) -> None:
    """A Gaussian copula whose inputs have the stated correlation: u^2 = 1 + 4 -+ 4 r."""
    result = copula(kind, 0.6)
    assert "correlated-inputs" in codes(result)
    for output, u2 in zip(result.outputs, (7.4, 2.6), strict=True):
        assert output.first.u == pytest.approx(math.sqrt(u2))
    assert result.run.u[0] == pytest.approx(math.sqrt(7.4), abs=4 * result.run.se_u[0])
    assert result.run.u[1] == pytest.approx(math.sqrt(2.6), abs=4 * result.run.se_u[1])


def test_correlated_inputs_of_several_kinds_are_refused() -> None:
    text = CORRELATED.replace("[{u: 0.8}]", "[{half_width: 1, distribution: rectangular}]")
    with pytest.raises(InputError) as raised:
        evaluated(text)
    assert str(raised.value).startswith("b.yaml:8: correlations: a cannot be correlated")


def test_correlated_inputs_of_different_degrees_of_freedom() -> None:
    """The smallest for the joint term, told; alone each input keeps its own."""
    text = """
        equation: a + b + c
        inputs: {a: {value: 0, u: 1, dof: 8}, b: {value: 0, u: 1, dof: 20}, c: {value: 0, u: 1}}
        correlations: [[a, b, 0.5]]
    """
    result = evaluated(text)
    assert "correlated-inputs" in codes(result)
    # v = 3 of the pair with 8, 1 of c: nu_eff = 4^2 / (3^2/8).
    assert single(result).first.dof == pytest.approx(16 * 8 / 9)


def test_coverage() -> None:
    """k given in the file, by the call, or from the probability."""
    text = "equation: x\ninputs: {x: {value: 0, u: 1, dof: 10}}\n"
    assert single(evaluated(text)).k == pytest.approx(2.228, abs=0.0005)
    assert single(evaluated(text + "coverage: {probability: 0.99}\n")).k == pytest.approx(
        3.169, abs=0.0005
    )
    stated = evaluated(text + "coverage: {k: 2}\n")
    assert (single(stated).k, single(stated).expanded) == (2.0, 2.0)
    assert stated.probability == pytest.approx(0.9545, abs=5e-5)
    called = evaluated(text + "coverage: {probability: 0.99}\n", k=3.0)
    assert single(called).k == 3.0
    assert called.probability == pytest.approx(0.9973, abs=5e-5)
    far = evaluated("equation: x\ninputs: {x: {value: 0, u: 1}}\n", k=5.0, trials=20_000)
    assert (single(far).expanded, far.probability) == (5.0, 0.999)


def test_linear_budgets_need_few_trials() -> None:
    """The control variate knows the distribution of a sum of unlike inputs, and its ends."""
    text = """
        equation: a + b + c + d
        inputs:
          a: {value: 0, u: 1, dof: 4}
          b: {value: 0, half_width: 2, distribution: rectangular, dof: 8}
          c: {value: 0, half_width: 1, distribution: arcsine}
          d: {value: 0, u: 0.5}
    """
    result = evaluated(text)
    # Plainly the ends would take (2 x 2.7 u / (tolerance/5))^2 = 1.2e6 trials.
    assert result.run.trials < 120_000
    plain = np.random.default_rng(11)
    m = 4_000_000
    draws = plain.standard_t(4, m) + 0.5 * plain.standard_normal(m)
    draws += 2 * plain.uniform(0.75, 1.25, m) * plain.uniform(-1, 1, m)
    draws += np.cos(2 * math.pi * plain.uniform(size=m))
    low, high = np.quantile(draws, [0.025, 0.975])
    # The plain quantile's standard error is about 2.7 u/sqrt(m) = 0.003.
    assert result.run.low[0] == pytest.approx(low, abs=0.012)
    assert result.run.high[0] == pytest.approx(high, abs=0.012)
    exact = math.sqrt(2 + 4 / 3 * (1 + 1 / 48) + 0.5 + 0.25)
    assert result.run.u[0] == pytest.approx(exact, abs=4 * result.run.se_u[0] + 1e-6)


def test_second_order_of_independent_inputs() -> None:
    """JCGM 100:2008, 5.1.2, note, term by term with derivatives by hand: y = x^2 z + sin(z)."""
    text = "equation: x**2*z + sin(z)\ninputs: {x: {value: 1.5, u: 0.2}, z: {value: 0.7, u: 0.3}}\n"
    first = single(evaluated(text)).first
    x, z, ux, uz = 1.5, 0.7, 0.2, 0.3
    fx, fz = 2 * x * z, x**2 + math.cos(z)
    fxx, fxz, fzz = 2 * z, 2 * x, -math.sin(z)
    fxxx, fxzz, fzxx, fzzz = 0.0, 0.0, 2.0, -math.cos(z)
    linear = (fx * ux) ** 2 + (fz * uz) ** 2
    extra = (0.5 * fxx**2 + fx * fxxx) * ux**4 + (0.5 * fzz**2 + fz * fzzz) * uz**4
    extra += (0.5 * fxz**2 + fx * fxzz) * ux**2 * uz**2 + (0.5 * fxz**2 + fz * fzxx) * uz**2 * ux**2
    assert first.u == pytest.approx(math.sqrt(linear))
    assert first.second_u == pytest.approx(math.sqrt(linear + extra))
    assert first.second_value == pytest.approx(first.value + 0.5 * (fxx * ux**2 + fzz * uz**2))


def test_second_order_of_correlated_inputs() -> None:
    """x y of jointly normal inputs: V = a^2 v + b^2 u + 2 a b c + u v + c^2, exact."""
    text = """
        equation: x*y
        inputs: {x: {value: 2, u: 0.5}, y: {value: 3, u: 0.4}}
        correlations: [[x, y, 0.6]]
    """
    first = single(evaluated(text)).first
    u, v, c = 0.25, 0.16, 0.6 * 0.5 * 0.4
    assert first.second_value == pytest.approx(6 + c)
    exact = 4 * v + 9 * u + 2 * 6 * c + u * v + c**2
    assert first.second_u == pytest.approx(math.sqrt(exact))


def test_cancelling_inputs_of_different_degrees_of_freedom_still_scatter() -> None:
    """r = 1 makes the first-order u 0; each t keeps a scale of its own, so the trials scatter.

    x - y = u z (s_5 - s_9): variance u^2 (5/3 + 9/7 - 2 E s_5 E s_9).
    """
    text = """
        equation: x - y
        inputs: {x: {value: 1, u: 0.1, dof: 5}, y: {value: 2, u: 0.1, dof: 9}}
        correlations: [[x, y, 1]]
    """
    result = evaluated(text, trials=200_000)
    assert single(result).first.u == 0.0

    def scale(nu: float) -> float:
        return math.sqrt(nu / 2) * math.gamma((nu - 1) / 2) / math.gamma(nu / 2)

    expected = 0.1 * math.sqrt(5 / 3 + 9 / 7 - 2 * scale(5) * scale(9))
    assert result.run.u[0] == pytest.approx(expected, abs=4 * float(result.run.se_u[0]))
