"""Derivatives of equations against formulas by hand, differences, and where there are none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mtu_cli.language import evaluate, parse, to_text
from mtu_cli.language.derivative import PLACE, Derivatives, derivatives, taylor
from mtu_cli.language.functions import BUDGET_FUNCTIONS, MACHINE_FUNCTIONS
from mtu_cli.language.slope import slope

FloatArray = NDArray[np.float64]


def at(text: str, **values: float) -> Derivatives:
    return derivatives(parse(text, BUDGET_FUNCTIONS), values, list(values))


S, C, TAN = math.sin(0.3), math.cos(0.3), math.tan(0.3)
# By hand, at x = 0.3: first, second and third derivative.
BY_HAND = {
    "x**4": (4 * 0.3**3, 12 * 0.3**2, 24 * 0.3),
    "x**-2": (-2 * 0.3**-3, 6 * 0.3**-4, -24 * 0.3**-5),
    "x**0.5": (0.5 * 0.3**-0.5, -0.25 * 0.3**-1.5, 0.375 * 0.3**-2.5),
    "1/x": (-(0.3**-2), 2 * 0.3**-3, -6 * 0.3**-4),
    "sin(x)": (C, -S, -C),
    "cos(x)": (-S, -C, S),
    "tan(x)": (1 / C**2, 2 * TAN / C**2, (2 + 4 * S**2) / C**4),
    "asin(x)": (0.91**-0.5, 0.3 * 0.91**-1.5, (1 + 2 * 0.09) * 0.91**-2.5),
    "acos(x)": (-(0.91**-0.5), -0.3 * 0.91**-1.5, -(1 + 2 * 0.09) * 0.91**-2.5),
    "atan(x)": (1 / 1.09, -0.6 / 1.09**2, (6 * 0.09 - 2) / 1.09**3),
    "exp(2*x)": (2 * math.exp(0.6), 4 * math.exp(0.6), 8 * math.exp(0.6)),
    "log(x)": (1 / 0.3, -1 / 0.09, 2 / 0.027),
    "sqrt(x)": (0.5 * 0.3**-0.5, -0.25 * 0.3**-1.5, 0.375 * 0.3**-2.5),
    "2**x": tuple(math.log(2) ** k * 2**0.3 for k in (1, 2, 3)),
    "abs(-3*x)": (3.0, 0.0, 0.0),
    "step(x)*x**2": (0.6, 2.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "pi": (0.0, 0.0, 0.0),
    "atan2(x, 2)": (2 / 4.09, -4 * 0.3 / 4.09**2, (12 * 0.09 - 16) / 4.09**3),
}


@pytest.mark.parametrize("text", BY_HAND)
def test_functions_of_one_variable(text: str) -> None:
    found = at(text, x=0.3)
    first, second, third = BY_HAND[text]
    assert found.first[0] == pytest.approx(first, rel=1e-12)
    assert found.second[0, 0] == pytest.approx(second, rel=1e-12)
    assert found.third[0] == pytest.approx(third, rel=1e-11)
    assert not found.faults


COMPOUND = [
    "x*y*z + x**2*y/z",
    "sin(x*y)*exp(-z)/(1 + x**2)",
    "(x + y)**z",
    "sqrt(x**2 + y**2 + z**2)",
    "atan2(y - 2*z, x)",
    "atan2(y, -x)*log(z)",
    "-tan(x/4)/(y - z)**3",
]


@pytest.mark.parametrize("text", COMPOUND)
def test_several_variables_against_differences(text: str) -> None:
    """An independent slow version: central differences with one step of Richardson's.

    Their error is of the order h^4 = 1e-8 for the first, and eps/h^2 = 1e-10 by rounding.
    """
    tree = parse(text, BUDGET_FUNCTIONS)
    point = np.array([0.7, 1.3, 0.4])
    names = ["x", "y", "z"]

    def f(p: FloatArray) -> float:
        return float(evaluate(tree, dict(zip(names, p.tolist(), strict=True))))

    def tilt(p: FloatArray, i: int, h: float = 1e-2) -> float:
        e = np.eye(3)[i]
        one = (f(p + h * e) - f(p - h * e)) / (2 * h)
        two = (f(p + 2 * h * e) - f(p - 2 * h * e)) / (4 * h)
        return (4 * one - two) / 3

    def bend(i: int, j: int, h: float = 1e-2) -> float:
        e = np.eye(3)[j]
        one = (tilt(point + h * e, i) - tilt(point - h * e, i)) / (2 * h)
        two = (tilt(point + 2 * h * e, i) - tilt(point - 2 * h * e, i)) / (4 * h)
        return (4 * one - two) / 3

    found = derivatives(tree, dict(zip(names, point.tolist(), strict=True)), names)
    scale = 1.0 + np.abs(found.second).max()
    assert found.value == pytest.approx(f(point), rel=1e-13)
    for i in range(3):
        assert found.first[i] == pytest.approx(tilt(point, i), abs=1e-5 * scale)
        for j in range(3):
            assert found.second[i, j] == pytest.approx(bend(i, j), abs=1e-4 * scale)


def test_third_order_along_two_directions() -> None:
    """f = x^3 + 2 x^2 y - y^3: the coefficients of s^a t^b along (1, 2) and (3, -1), by hand."""
    tree = parse("x**3 + 2*x**2*y - y**3", BUDGET_FUNCTIONS)
    along = {"x": np.array([[1.0], [3.0]]), "y": np.array([[2.0], [-1.0]])}
    found, faults = taylor(tree, {"x": 0.5, "y": -1.5}, along.get, 1)
    assert not faults
    s = np.polynomial.polynomial
    # x = 0.5 + s + 3 t, y = -1.5 + 2 s - t, as polynomials in s with t = 0 and the other way.
    x, y = [0.5, 1.0], [-1.5, 2.0]
    in_s = s.polyadd(s.polypow(x, 3), 2 * s.polymul(s.polypow(x, 2), y))
    in_s = s.polysub(in_s, s.polypow(y, 3))
    assert found[[PLACE[a, 0] for a in range(4)], 0] == pytest.approx(in_s)
    # s^2 t: 3 dx^2 * 3 + 2 (dx^2 * -1 + 2 * 1 * 3 * 2) - 3 * 4 * -1 with dx = 1, dy = 2.
    assert found[PLACE[2, 1], 0] == pytest.approx(3 * 3 + 2 * (-1 + 12) + 12)


@pytest.mark.parametrize(
    ("text", "what", "column"),
    [
        ("1 + abs(x)", "abs()", 5),
        ("step(x)", "step()", 1),
        ("sqrt(x)", "sqrt()", 1),
        ("x**0.5", "'**'", 2),
        ("asin(x + 1)", "asin()", 1),
        ("atan2(x, x)", "atan2", 1),
        ("sqrt(x**2)", "sqrt()", 1),
        ("1/x", "'/'", 2),
        ("x**-2", "'**'", 2),
    ],
)
def test_where_no_derivative_exists(text: str, what: str, column: int) -> None:
    found = at(text, x=0.0)
    assert math.isnan(found.first[0]) or math.isnan(found.second[0, 0])
    assert what in found.faults[0].text
    assert found.faults[0].column == column


def test_a_constant_inside_needs_no_derivative() -> None:
    """abs(0) is 0 where nothing in it varies, and sqrt(0) too."""
    found = derivatives(parse("abs(k)*x + sqrt(k) + step(k)"), {"k": 0.0, "x": 2.0}, ["x"])
    assert (found.value, found.first[0]) == (1.0, 0.0)
    assert not found.faults


def test_higher_orders_that_do_not_exist_leave_the_first_alone() -> None:
    found = at("x**1.5", x=0.0)
    assert found.first[0] == 0.0
    assert math.isnan(found.second[0, 0])


def test_integer_powers_of_zero_and_of_negative_numbers() -> None:
    assert at("x**2", x=0.0).second[0, 0] == 2.0
    assert at("x**3", x=-2.0).first[0] == 12.0
    assert at("x**0", x=0.0).first[0] == 0.0


@pytest.mark.parametrize(
    ("text", "values", "outer"),
    [
        # x^4 vanishes to the third order: these are x^2, |x|, x^2 + y^2 and |x y|.
        ("sqrt(x**4)", {"x": 0.0}, "sqrt()"),
        ("(x**4)**0.25", {"x": 0.0}, "'**'"),
        ("sqrt((x*x + y*y)**2)", {"x": 0.0, "y": 0.0}, "sqrt()"),
        ("abs(x*x*y*y)", {"x": 0.0, "y": 0.0}, "abs()"),
    ],
)
def test_an_argument_that_vanishes_beyond_the_third_order(
    text: str, values: dict[str, float], outer: str
) -> None:
    found = at(text, **values)
    assert found.value == 0.0
    assert np.all(np.isnan(found.first))
    assert outer in found.faults[0].text
    # By a name that it does not hold the output does vary.
    other = at(f"{text} + 2*z", **values, z=1.0)
    assert other.first[-1] == 2.0
    assert np.all(np.isnan(other.first[:-1]))


@pytest.mark.parametrize(("x", "value"), [(-1.0, math.pi), (-0.25, math.pi), (0.0, 0.0)])
def test_atan2_on_its_cut_has_a_value_alone(x: float, value: float) -> None:
    found = at("atan2(y, x) + z", y=0.0, x=x, z=0.5)
    assert found.value == value + 0.5
    assert np.all(np.isnan(found.first[:2]))
    assert found.first[2] == 1.0
    (fault,) = found.faults
    assert ("atan2" in fault.text, fault.column) == (True, 1)


def test_atan2_of_constants_on_its_cut_is_a_constant() -> None:
    found = derivatives(parse("x*atan2(0*x, k)", BUDGET_FUNCTIONS), {"x": 2.0, "k": 1.0}, ["x"])
    assert found.first[0] == 0.0
    tree = parse("x*atan2(j, k)", BUDGET_FUNCTIONS)
    found = derivatives(tree, {"x": 2.0, "j": 0.0, "k": -1.0}, ["x"])
    assert found.first[0] == math.pi
    assert not found.faults


def test_a_sum_of_products_of_many_names() -> None:
    """Of 30 names, by hand: the second derivatives are the coefficients."""
    rng = np.random.default_rng(2)
    names = [f"x{i}" for i in range(30)]
    C = np.triu(rng.integers(1, 9, (30, 30)), 1)[:, ::-1] * (rng.random((30, 30)) < 0.15)
    pairs = np.argwhere(C)
    text = " + ".join(f"{C[i, j]}*x{i}*x{j}" for i, j in pairs)
    H = C + C.T
    point = rng.normal(size=30)
    values = dict(zip(names, point.tolist(), strict=True))
    found = derivatives(parse(f"{text} + sqrt(x0*x0)"), values, names)
    sign = math.copysign(1.0, point[0])
    assert found.second == pytest.approx(H)
    assert found.first == pytest.approx(H @ point + sign * np.eye(30)[0])
    faulty = derivatives(parse(f"{text} + sqrt(x0*x0)"), values | {"x0": 0.0}, names)
    assert len(faulty.faults) == 1


EQUATIONS = [
    "3 - x/2 + 2*y",
    "-x*y - (y - x)*x",
    "y/(1 + x**3)",
    "(1 + x)**y*2**x",
    "y*sin(2*x)*exp(-x/3)",
    "cos(x) + log(x*y)*sqrt(1 + x)",
    "abs(x - 2)*y + abs(x)",
    "step(x - 1)*x + step(y)",
]


@pytest.mark.parametrize("text", EQUATIONS)
def test_the_derivative_of_an_equation_is_an_equation(text: str) -> None:
    for x in (0.3, 1.7):
        at = {"x": x, "y": 0.8}
        found = slope(parse(text), "x")
        assert parse(to_text(found)) is not None
        expected = derivatives(parse(text), at, ["x"]).first[0]
        assert evaluate(parse(to_text(found)), at) == pytest.approx(expected, rel=1e-12)


def test_every_function_has_one() -> None:
    assert all(any(f"{name}(" in text for text in EQUATIONS) for name in MACHINE_FUNCTIONS)
