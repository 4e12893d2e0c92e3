"""Derivatives of equations against formulas by hand, differences, and where there are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mtu_cli.language import evaluate, parse, to_text
from mtu_cli.language.derivative import Derivatives, derivatives, slope
from mtu_cli.language.functions import BUDGET_FUNCTIONS, MACHINE_FUNCTIONS


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


EQUATIONS = [
    "3 - x/2 + 2*y",
    "-x*y - (y - x)*x",
    "x*y*z + x**2*y/z",
    "y/(1 + x**3)",
    "(1 + x)**y*2**x",
    "sin(x*y)*exp(-z)/(1 + x**2)",
    "cos(x) + log(x*y)*sqrt(1 + x*z)",
    "abs(x - 2)*y + abs(x)",
    "step(x - 1)*x + step(y)",
]


@pytest.mark.parametrize("text", EQUATIONS)
@pytest.mark.parametrize("x", [0.3, 1.7])
def test_several_variables_against_the_derivative_as_an_equation(text: str, x: float) -> None:
    """Another method: each derivative is an equation, which is written, read and evaluated."""
    at, names, tree = {"x": x, "y": 0.8, "z": 0.4}, list("xyz"), parse(text)
    found = derivatives(tree, at, names)
    assert found.value == pytest.approx(float(evaluate(tree, at)), rel=1e-13)
    for i, name in enumerate(names):
        once = parse(to_text(slope(tree, name)))
        assert found.first[i] == pytest.approx(float(evaluate(once, at)), rel=1e-12)
        for j, other in enumerate(names):
            twice = slope(once, other)
            assert found.second[i, j] == pytest.approx(float(evaluate(twice, at)), abs=1e-11)
        thrice = slope(slope(once, name), name)
        assert found.third[i] == pytest.approx(float(evaluate(thrice, at)), abs=1e-9)


def test_every_function_has_one() -> None:
    assert all(any(f"{name}(" in text for text in EQUATIONS) for name in MACHINE_FUNCTIONS)


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


def test_corners_with_derivatives() -> None:
    """abs(0) is 0 where nothing in it varies; powers of 0 and of negative numbers."""
    found = derivatives(parse("abs(k)*x + sqrt(k) + step(k)"), {"k": 0.0, "x": 2.0}, ["x"])
    assert (found.value, found.first[0], found.faults) == (1.0, 0.0, ())
    half = at("x**1.5", x=0.0)
    assert half.first[0] == 0.0
    assert math.isnan(half.second[0, 0])
    assert at("x**2", x=0.0).second[0, 0] == 2.0
    assert at("x**3", x=-2.0).first[0] == 12.0
    assert at("x**0", x=0.0).first[0] == 0.0


@pytest.mark.parametrize(("x", "value"), [(-1.0, math.pi), (-0.25, math.pi), (0.0, 0.0)])
def test_atan2_on_its_cut_has_a_value_alone(x: float, value: float) -> None:
    found = at("atan2(y, x) + z", y=0.0, x=x, z=0.5)
    assert found.value == value + 0.5
    assert np.all(np.isnan(found.first[:2]))
    assert found.first[2] == 1.0
    (fault,) = found.faults
    assert ("atan2" in fault.text, fault.column) == (True, 1)
