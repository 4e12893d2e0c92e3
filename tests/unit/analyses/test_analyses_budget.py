"""Budgets: first order, correlation, Monte Carlo, and what other tools get wrong.

Oracles: closed forms by hand, plain simulations with another generator, and the engine's own
standard errors (four of them).
"""

import math
from pathlib import Path

import numpy as np
import pytest
from budget_examples import CORRELATED, codes, evaluated, single
from graph_examples import SHIPPED, graph_of, shipped

from mtu_cli.analyses.graph import simulate_graph, sweep_graph
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray


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
    assert np.cov(result.run.samples) == pytest.approx(C @ V @ C.T, abs=0.02)
    own = result.covariance
    r = own[0, 1] / math.sqrt(own[0, 0] * own[1, 1])
    assert result.correlation[0, 1] == pytest.approx(r)


@pytest.mark.parametrize("kind", ["rectangular", "arcsine"])
def test_correlated_inputs_that_are_not_normal(kind: str) -> None:
    """A Gaussian copula whose inputs have the stated correlation: u^2 = 1 + 4 -+ 4 r."""
    text = "equations: {s: a + b, d: a - b}\ninputs:\n  b: {value: 0, u: 2}\n"
    text += f"  a: {{value: 0, u: 1, distribution: {kind}}}\ncorrelations: [[a, b, 0.6]]\n"
    result = evaluated(text, trials=200_000)
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
    run = evaluated(text).run
    # Plainly the ends would take (2 x 2.7 u / (tolerance/5))^2 = 1.2e6 trials.
    assert run.trials < 120_000
    assert run.low[0] == pytest.approx(-run.high[0], abs=0.012)
    exact = math.sqrt(2 + 4 / 3 * (1 + 1 / 48) + 0.5 + 0.25)
    assert run.u[0] == pytest.approx(exact, abs=4 * run.se_u[0] + 1e-6)


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


def test_a_square_at_zero() -> None:
    """Peers: u = 0 for x^2 at 0 without a word (suncal, metrolopy, uncertainties issue 92).

    Rectangular, a^2 = 3 u^2: V = a^4 (1/5 - 1/9) = 4 a^4/45, mean u^2; a normal x is in JCGM 101.
    """
    text = "equation: x**2\ninputs: {x: {value: 0, u: 0.2, distribution: rectangular}}\n"
    result = evaluated(text, trials=400_000)
    first, second = single(result), math.sqrt(4 / 45) * 0.12
    assert first.u == 0.0
    assert first.second_u == pytest.approx(second)
    assert first.second_value == pytest.approx(0.04)
    assert result.run.u[0] == pytest.approx(second, abs=4 * result.run.se_u[0])
    assert result.run.mean[0] == pytest.approx(0.04, abs=4 * result.run.se_mean[0])
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
    # r of a sample of t with 6 degrees of freedom: (1 - r^2) sqrt((1 + kappa/3)/M), kappa = 3.
    samples = result.run.samples[:2]
    error = (1 - 0.7**2) * math.sqrt(2 / samples.shape[1])
    assert np.asarray(np.corrcoef(samples))[0, 1] == pytest.approx(0.7, abs=4 * error)
    for i, u in enumerate((1.0, 2.0, math.sqrt(1 + 4 - 2 * 0.7 * 2))):
        assert result.run.high[i] == pytest.approx(
            coverage_factor(0.95, 6.0) * u, abs=4 * result.run.se_high[i] + 1e-9
        )


# Corners: full correlation, inputs that no equation has, a step.


def pair(equation: str, first: str, second: str, r: float) -> str:
    return (
        f"equation: {equation}\ninputs:\n  x: {{value: 1, {first}}}\n"
        f"  y: {{value: 1, {second}}}\ncorrelations: [[x, y, {r!r}]]\n"
    )


@pytest.mark.parametrize("shape", ["rectangular", "arcsine", "trapezoidal, top: 0.3"])
@pytest.mark.parametrize(("equation", "r"), [("x - y", 1.0), ("x + y", -1.0)])
def test_fully_correlated_shapes_cancel(shape: str, equation: str, r: float) -> None:
    """Equal inputs that rise together differ by nothing: u = 0 by every method."""
    entry = f"half_width: 1, distribution: {shape}"
    result = evaluated(pair(equation, entry, entry, r))
    assert single(result).u == 0.0
    assert result.run.u[0] == 0.0
    assert result.run.low[0] == pytest.approx(result.run.high[0], abs=2e-15)
    assert single(result).validation.passed is True
    assert "validation-failed" not in codes(result)


def test_a_coefficient_that_cannot_be_had_is_refused() -> None:
    """And one that just can be is not altered: a normal beside a rectangle, at most sqrt(3/pi)."""
    first, most = "half_width: 1, distribution: rectangular", math.sqrt(3 / math.pi)
    for r in (most + 1e-6, 0.979, -0.979):
        with pytest.raises(InputError) as raised:
            evaluated(pair("x + y", first, "u: 1", r))
        text = str(raised.value)
        assert text.startswith("b.yaml:7: correlations: x, y cannot be correlated")
        assert "-0.977205 to 0.977205" in text
    # What the message offers is had: u^2 of the sum tells the coefficient that was drawn.
    result = evaluated(pair("x + y", first, "u: 1", 0.977205), trials=400_000)
    u = math.sqrt(1 / 3 + 1 + 2 * 0.977205 / math.sqrt(3))
    assert result.run.u[0] == pytest.approx(u, abs=4 * result.run.se_u[0])


def test_first_order_of_a_step_is_not_valid() -> None:
    """P(N(10, 0.001) <= 10.0035) = 1 - 2.3e-4: both intervals are [1, 1], u is not 0."""
    text = "equation: step(10.0035 - x)\ninputs:\n  x: {value: 10, u: 0.001}\n"
    result = evaluated(text, trials=400_000)
    (item,) = result.outputs
    assert item.u == 0
    assert result.run.low[0] == result.run.high[0] == 1
    chance = 0.5 * math.erfc(-3.5 / math.sqrt(2))
    # Five relative standard errors of u = sqrt(q), 1/(2 sqrt(n q)).
    u = math.sqrt(chance * (1 - chance))
    assert result.run.u[0] == pytest.approx(u, rel=2.5 / math.sqrt(400_000 * (1 - chance)))
    assert item.validation.passed is False
    (told,) = (item for item in result.warnings if item.code == "validation-failed")
    assert told.facts["difference"].startswith("u 0 against 0.01")
    # Where no trial differs there is nothing that first order misses.
    sure = evaluated(text.replace("10.0035", "11"), trials=10_000)
    assert sure.outputs[0].validation.passed is True


# graph simulate against independent simulations and what is known exactly.


M = 200_000
RATIO = 5 * (2 * M) ** -0.5
"""Five standard errors of a sample standard deviation, relative."""


def probed(rng: np.random.Generator, centre: FloatArray, u_w: float, r: FloatArray) -> FloatArray:
    """Ball centres (M, 3) as Stryczek, Figure 5, has them, written out."""
    x1 = centre[0] - 12.5 + u_w * rng.standard_normal(M)
    x2 = centre[0] + 12.5 + u_w * rng.standard_normal(M)
    y1 = centre[1] - 12.5 + u_w * rng.standard_normal(M)
    y2 = centre[1] + 12.5 + u_w * rng.standard_normal(M)
    z1 = centre[2] + 12.5 + u_w * rng.standard_normal(M)
    return np.column_stack([(x1 + x2) / 2, (y1 + y2) / 2, z1 - r])


def axis(centres: list[FloatArray], alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stryczek, eqs. (8)-(27), with the index of (14) and the sign of (22) put right."""
    P1, P2, P3 = centres
    P4 = (P2 + P3) / 2
    R = np.linalg.norm(P3 - P4, axis=1) / np.sin(alpha)
    e = (P4 - P1) / np.linalg.norm(P4 - P1, axis=1)[:, None]
    normal = np.cross(P1 - P2, P3 - P2)
    return P1 + R[:, None] * e, normal / np.linalg.norm(normal, axis=1)[:, None]


def test_distance_of_axes_against_a_plain_simulation() -> None:
    rng = np.random.default_rng(3)
    u_w, r = math.hypot(1e-3, 1e-3), np.full(M, 12.5)
    tilted, turned = [], []
    for turn in (0, -math.pi / 6, math.pi / 6):
        c, s = math.cos(turn), math.sin(turn)
        tilted.append(probed(rng, np.array([0, 110 * c - 50 * s, 50 * c + 110 * s]), u_w, r))
    for turn in (0, -2 * math.pi / 3, 2 * math.pi / 3):
        spot = np.array([-110 * math.sin(turn), 110 * math.cos(turn), 50])
        turned.append(probed(rng, spot, u_w, r))
    PA, VA = axis(tilted, np.full(M, math.pi / 6))
    PC, VC = axis(turned, np.full(M, 2 * math.pi / 3))
    PT = PC - 100 * VC
    t = np.einsum("ij,ij->i", VA, PT - PA)
    PO = PA + t[:, None] * VA
    d = np.linalg.norm(PO - PT, axis=1)
    result = simulate_graph(shipped("axes-a-and-c"), Settings())
    known = {str(c.output): c for c in result.coordinates}
    for name, sample in zip(("PO.x", "PO.y", "PO.z", "d_AC"), (*PO.T, d), strict=True):
        item = known[name]
        assert sample.mean() == pytest.approx(item.mean, abs=5 * item.u / M**0.5)
        assert sample.std(ddof=1) == pytest.approx(item.u, rel=RATIO)
    assert known["d_AC"].first_order_u == pytest.approx(known["d_AC"].u, rel=1e-4)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_graphs(path: Path) -> None:
    graph = shipped(path.stem)
    assert sum(map(len, graph.rounds)) == len(graph.graph.transitions)
    result = simulate_graph(graph, Settings())
    assert result.converged
    assert {item.code for item in result.warnings} <= {"not-estimable"}
    for item in result.coordinates:
        if item.validation is not None:
            assert item.validation.passed
            assert item.first_order_u == pytest.approx(item.u, rel=1e-3)
            assert sum(item.shares.values()) == pytest.approx(1)


SQUARE = """
places:
  x: {kind: constant, value: 0, u: 3}
  y: {kind: constant}
transitions:
  - {do: compute, in: [x], out: y, formula: x**2}
"""


def test_a_square_at_zero_of_a_graph(tmp_path: Path) -> None:
    """First order says 0; y = 9 chi^2 with one degree of freedom: mean 9, u 9 sqrt 2."""
    result = simulate_graph(graph_of(tmp_path, SQUARE), Settings())
    (item,) = result.coordinates
    assert item.first_order_u == 0
    assert [warning.code for warning in result.warnings] == ["not-estimable"]
    assert item.converged
    assert item.mean == pytest.approx(9, abs=5 * item.u / item.trials**0.5)
    assert item.u == pytest.approx(9 * 2**0.5, abs=5 * item.se_u)
    assert item.validation is None


# graph sweep: the formula, what has no effect, how far the trials of a grid go.


@pytest.mark.parametrize(
    ("of", "grid", "form", "coefficients"),
    [
        # u^2 = (u1^2 + u2^2/n + u3^2)/2, here (1 + 1/n)/2 um^2: repeats average the probe alone.
        ("P1.x", {"repeats": [1, 2, 4, 10]}, "a/repeats + b", (0.5, 0.5)),
        # u^2 = u1^2 + u2^2 + u_r^2, u_r = 0.2 um: other sources are a constant.
        ("P1.z", {"axis_um": [0.5, 1, 2], "probe_um": [0.5, 1], "repeats": [1, 4]},
         "a*probe_um^2/repeats + b*axis_um^2 + c", (1, 1, 0.04)),
    ],
)  # fmt: skip
def test_the_formula_of_a_ball(
    of: str, grid: dict[str, list[float]], form: str, coefficients: tuple[float, ...]
) -> None:
    swept = sweep_graph(shipped("ball-centre"), Settings(trials=20_000), of, grid)
    assert swept.formula is not None
    assert swept.formula.form == f"u_um = sqrt({form})"
    assert tuple(swept.formula.coefficients.values()) == pytest.approx(coefficients)
    assert len(swept.grid) == math.prod(map(len, grid.values()))
