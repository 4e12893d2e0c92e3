"""Budgets: first order, correlation, Monte Carlo, and what other tools get wrong.

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
from mtu_cli.stats.coverage import coverage_factor


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
    assert math.isnan(single(result).u)
    assert math.isnan(single(result).expanded)
    assert "not-differentiable" in codes(result)
    assert result.run.u[0] == pytest.approx(exact, abs=4 * result.run.se_u[0])


def test_shares_and_covariance() -> None:
    """By hand: c = (1, 2), u = (1, 0.5), r = 0.7: shares 1.7/3.4 each; two outputs C V C'."""
    assert single(evaluated(CORRELATED)).share == pytest.approx([0.5, 0.5])
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
        assert output.u == pytest.approx(math.sqrt(u2))
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
    assert single(result).dof == pytest.approx(16 * 8 / 9)


def test_coverage() -> None:
    """k given in the file, by the call, or from the probability."""
    text = "equation: x\ninputs: {x: {value: 0, u: 1, dof: 10}}\n"
    assert single(evaluated(text)).k == pytest.approx(2.228, abs=0.0005)
    assert single(evaluated(text + "coverage: {probability: 0.99}\n")).k == pytest.approx(
        3.169, abs=0.0005
    )
    stated = evaluated(text + "coverage: {k: 2}\n")
    assert (single(stated).k, single(stated).expanded) == (2.0, 2.0)
    assert stated.run.probability == pytest.approx(0.9545, abs=5e-5)
    called = evaluated(text + "coverage: {probability: 0.99}\n", k=3.0)
    assert single(called).k == 3.0
    assert called.run.probability == pytest.approx(0.9973, abs=5e-5)
    far = evaluated("equation: x\ninputs: {x: {value: 0, u: 1}}\n", k=5.0, trials=20_000)
    assert (single(far).expanded, far.run.probability) == (5.0, 0.999)


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
    first = single(evaluated(text))
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
    first = single(evaluated(text))
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
    assert single(result).u == 0.0

    def scale(nu: float) -> float:
        return math.sqrt(nu / 2) * math.gamma((nu - 1) / 2) / math.gamma(nu / 2)

    expected = 0.1 * math.sqrt(5 / 3 + 9 / 7 - 2 * scale(5) * scale(9))
    assert result.run.u[0] == pytest.approx(expected, abs=4 * float(result.run.se_u[0]))


# What other tools get wrong about budgets, each with the wrong figure: here they are right.


SEVEN = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])


def test_type_a_and_type_b_on_one_input_count_once() -> None:
    """Peers: suncal counts type B twice by Monte Carlo (1.434 for 1.030).

    s/sqrt(7) = 0.247 and u = 1: u = sqrt(1 + 0.247^2) = 1.030; drawn as t of 6 degrees of
    freedom the type A part is 0.3025, and u by Monte Carlo 1.0448.
    """
    readings = (SEVEN * 0.247 * math.sqrt(7) / SEVEN.std(ddof=1)).tolist()
    result = evaluated(f"equation: x\ninputs: {{x: {{readings: {readings}, u: 1}}}}\n", digits=3)
    output = single(result)
    assert output.u == pytest.approx(1.030, abs=0.0005)
    assert output.dof == pytest.approx(6 * (output.u / 0.247) ** 4)
    expected = math.sqrt(1 + 1.5 * 0.247**2)
    assert result.run.u[0] == pytest.approx(expected, abs=4 * result.run.se_u[0] + 1e-6)


@pytest.mark.parametrize(
    ("entry", "second", "mean"),
    [
        # Normal: x^2/u^2 is chi-squared: mean u^2, standard deviation sqrt(2) u^2.
        ("u: 0.2", math.sqrt(2) * 0.04, 0.04),
        # Rectangular, a^2 = 3 u^2: V = a^4 (1/5 - 1/9) = 4 a^4/45.
        ("u: 0.2, distribution: rectangular", math.sqrt(4 / 45) * 0.12, 0.04),
        # Arcsine, a^2 = 2 u^2: V = a^4 (3/8 - 1/4) = a^4/8.
        ("u: 0.2, distribution: arcsine", math.sqrt(1 / 8) * 0.08, 0.04),
    ],
)
def test_a_square_at_zero(entry: str, second: float, mean: float) -> None:
    """Peers: u = 0 for x^2 at 0 without a word (suncal, metrolopy, uncertainties issue 92)."""
    result = evaluated(f"equation: x**2\ninputs: {{x: {{value: 0, {entry}}}}}\n", trials=400_000)
    first = single(result)
    assert first.u == 0.0
    assert first.second_u == pytest.approx(second)
    assert first.second_value == pytest.approx(mean)
    assert result.run.u[0] == pytest.approx(second, abs=4 * result.run.se_u[0])
    assert result.run.mean[0] == pytest.approx(mean, abs=4 * result.run.se_mean[0])
    assert "second-order" in codes(result)
    assert single(result).validation.passed is False


def test_samples_that_are_not_finite_are_an_error() -> None:
    """Peers drop such samples in silence (suncal); here they stop the command, counted."""
    with pytest.raises(InputError) as raised:
        evaluated("equation: log(x)\ninputs: {x: {value: 1, u: 0.6}}\n")
    (found,) = raised.value.findings
    assert (found.code, found.line, found.path) == ("no-finite-value", 3, "equation")


def test_a_correlation_matrix_that_cannot_be_is_never_altered() -> None:
    """Peers alter or never check it (uncertainties issues 101 and 95).

    r = -0.9 between all three: the smallest eigenvalue is 1 - 2 x 0.9 = -0.8.
    """
    inputs = "inputs: {a: {value: 0, u: 1}, b: {value: 0, u: 2}, c: {value: 0, u: 3}, d: 1}\n"
    pairs = "correlations: [[a, b, -0.9], [b, c, -0.9], [a, c, -0.9]]\n"
    with pytest.raises(InputError) as raised:
        evaluated("equation: a + b + c + d\n" + inputs + pairs)
    text = str(raised.value)
    assert text.startswith("b.yaml:5: correlations: ")
    assert "smallest eigenvalue of the correlation matrix is -0.8" in text
    for pair in ("a-b -0.9", "b-c -0.9", "a-c -0.9"):
        assert pair in text


# What the trials of a budget draw, also at the ends of the number range.


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
