"""Budgets at corners: full correlation, cuts of functions, inputs that no equation has."""

from __future__ import annotations

import math
import tracemalloc

import pytest
from budget_examples import codes, evaluated, single
from scipy.special import ndtri, stdtrit

from mtu_cli.findings import InputError


def pair(equation: str, first: str, second: str, r: float) -> str:
    return (
        f"equation: {equation}\ninputs:\n  x: {{value: 1, {first}}}\n"
        f"  y: {{value: 1, {second}}}\ncorrelations: [[x, y, {r!r}]]\n"
    )


@pytest.mark.parametrize(
    "entry",
    [
        "half_width: 1, distribution: rectangular",
        "half_width: 1, distribution: triangular",
        "half_width: 1, distribution: arcsine",
        "half_width: 1, top: 0.3, distribution: trapezoidal",
    ],
)
@pytest.mark.parametrize(("equation", "r"), [("x - y", 1.0), ("x + y", -1.0)])
def test_fully_correlated_shapes_cancel(entry: str, equation: str, r: float) -> None:
    """Equal inputs that rise together differ by nothing: u = 0 by every method."""
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


def test_atan2_on_its_cut_has_a_monte_carlo() -> None:
    """atan2(0, -1) = pi with its sign open: the mean is 0, u that of +-(pi - small)."""
    result = evaluated(
        "equation: atan2(y, x)\ninputs: {y: {value: 0, u: 0.001}, x: {value: -1, u: 0.001}}\n"
    )
    output, run = single(result), result.run
    assert output.value == math.pi
    assert math.isnan(output.u)
    assert "not-differentiable" in codes(result)
    assert run.mean[0] == pytest.approx(0.0, abs=4 * run.se_mean[0])
    # |angle| is pi - |y/x|, mean sqrt(2/pi) 0.001 below pi.
    u = math.pi - 0.001 * math.sqrt(2 / math.pi)
    assert run.u[0] == pytest.approx(u, abs=4 * run.se_u[0] + 1e-5)
    still = evaluated("equation: x*atan2(0*x, 1)\ninputs: {x: {value: -1, u: 0.001}}\n")
    assert single(still).u == 0.0


@pytest.mark.parametrize("equation", ["sqrt(x**4)", "(x**4)**0.25"])
def test_no_second_order_is_claimed_where_none_exists(equation: str) -> None:
    """They are x^2, of u = sqrt(2), and |x|, without a derivative: not u = 0."""
    result = evaluated(f"equation: {equation}\ninputs: {{x: {{value: 0, u: 1}}}}\n")
    assert math.isnan(single(result).u)
    assert math.isnan(single(result).second_u)
    assert "not-differentiable" in codes(result)
    assert "second-order" not in codes(result)


def test_inputs_that_no_equation_has_take_little_memory() -> None:
    """800 inputs of which two are used: 3.7 GB when all their pairs were differentiated."""
    many = "".join(f"  x{i}: {{value: 1, u: 0.1}}\n" for i in range(800))
    tracemalloc.start()
    result = evaluated("equation: x0*x1\ninputs:\n" + many, trials=20_000, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A block's draws of all inputs are 800 x 2048 numbers, twice: what matters is no cube.
    assert peak < 300e6
    first = single(result)
    assert first.u == pytest.approx(0.1 * math.sqrt(2))
    # u^2(x0 x1) = 0.02 + 0.1^4 exactly, which is its second order.
    assert first.second_u == pytest.approx(math.sqrt(0.02 + 1e-4))


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


# The Monte Carlo's own standard errors, distribution by distribution, against closed forms.


STATISTICS = ("mean", "u", "low", "high")


# Entry of the file, standard deviation, upper end of the 95 % interval.
SHAPES = {
    "normal": ("u: 1", 1.0, float(ndtri(0.975))),
    "t9": ("u: 1, dof: 9", math.sqrt(9 / 7), float(stdtrit(9, 0.975))),
    "rectangular": ("half_width: 1, distribution: rectangular", math.sqrt(1 / 3), 0.95),
    "triangular": (
        "half_width: 1, distribution: triangular",
        math.sqrt(1 / 6),
        1 - math.sqrt(0.05),
    ),
    "trapezoidal": (
        "half_width: 1, top: 0.5, distribution: trapezoidal",
        math.sqrt(1.25 / 6),
        1 - math.sqrt(0.05 * 0.75),
    ),
    "arcsine": (
        "half_width: 1, distribution: arcsine",
        math.sqrt(1 / 2),
        math.sin(0.475 * math.pi),
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_in_a_long_run(name: str) -> None:
    """2e6 trials: mean, u and ends within four of the standard errors that are stated for them.

    A bias of 1e-4 u at an end, a hundredth of the tolerance of two digits, is found. What the
    control variate gives exactly (a normal or t as it is) is so to 1e-6.
    """
    entry, u, end = SHAPES[name]
    text = f"equation: x\ninputs: {{x: {{value: 0, {entry}}}}}\n"
    found = evaluated(text, seed=11, trials=2_000_000, threads=2).run
    for statistic, exact in zip(STATISTICS, (0.0, u, -end, end), strict=True):
        value, error = getattr(found, statistic)[0], getattr(found, f"se_{statistic}")[0]
        assert value == pytest.approx(exact, abs=4.0 * error + 1e-6 * u), statistic
        assert error <= 5e-4 * u
