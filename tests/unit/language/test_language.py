"""Equations: what they mean, their derivatives and units."""

import math
import time
from typing import Any

import numpy as np
import pytest

from mtu_cli.findings import Finding, InputError
from mtu_cli.language import check_dimension, evaluate, linear_form, names, parse, to_text
from mtu_cli.language.derivative import Derivatives, derivatives
from mtu_cli.language.functions import BUDGET_FUNCTIONS, MACHINE_FUNCTIONS
from mtu_cli.language.parser import BRACED, DOTTED, MAX_CHARACTERS, MAX_DEPTH, MAX_OPERATORS
from mtu_cli.language.tree import Call, Name, Number
from mtu_cli.language.unit_algebra import check_consistent
from mtu_cli.units import ANY, PARAMETER_UNITS, internal, unit_powers

SECONDS = 1.0


def fault_of(text: str) -> Finding:
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        parse(text)
    assert time.process_time() - start < SECONDS
    (fault,) = caught.value.findings
    return fault


def test_the_tree_has_columns_and_folded_constants() -> None:
    sine = Call("sin", (Call("neg", (Name("b", 11),), 10),), 5)
    assert parse("a - sin( -b)") == Call("-", (Name("a", 1), sine), 3)
    assert parse("x + 2*3") == Call("+", (Name("x", 1), Number(6.0, 6)), 3)
    assert names(parse("z*ey_x + sin(x)*z - pi")) == {"z": 1, "ey_x": 3, "x": 14}


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("", 1, "unexpected end"), ("1..2", 3, "unexpected '.2'"), ("1e", 2, "unexpected 'e'"),
        ("1_000", 2, "unexpected '_000'"), ("x y", 3, "unexpected 'y'"),
        ("x +", 4, "unexpected end"), ("x * / y", 5, "unexpected '/'"),
        ("x + (y * (2 + 1)", 17, "'(' at column 5"), ("x + 1)", 6, "unexpected ')'"),
        ("sin x", 1, "sin has 0 arguments"), ("sin()", 5, "unexpected ')'"),
        ("sin(1, 2)", 1, "2 arguments"), ("x = 1", 3, "'='"), ("3 ^ 2", 3, "'^'"),
        ("x.real", 2, "'.'"), ("x^2", 2, "+ - * / **"), ("2 x", 3, "such as * between factors"),
        ("zzz(y)", 1, "one of: sin, cos, exp"), ("x)", 2, "an operator or the end"),
        ("lambda: 0", 7, "':'"), ("x × 2", 3, "'×'"), ("٣ + x", 1, "'٣'"),
        ("x \u2212 1", 3, "'\u2212'"), ("x\x00", 2, r"\x00"), ("1/0", 2, "no finite value"),
        ("sqrt(-1) + x", 1, "no finite value"), ("(-8)**0.5", 5, "no finite value"),
        ("9**9**9**9", 5, "no finite value"), ("x*1e999", 3, "not a finite number"),
        ("__import__('os')", 12, "'"), ("eval(x)", 1, "unknown function at column 1: 'eval'"),
        ("pi(2)", 1, "unknown function at column 1: 'pi'"),
        ("(" * 5000 + "x" + ")" * 5000, MAX_DEPTH + 1, "levels"),
        ("sin(" * 3900 + "x" + ")" * 3900, 4 * MAX_DEPTH + 1, "levels"),
        ("-" * 200 + "x", MAX_DEPTH + 1, "levels"), ("-" * 9000 + "x", 301, "300 operators"),
        ("**".join("x" * 200), 3 * MAX_DEPTH + 1, "levels"),
        ("x" * (MAX_CHARACTERS + 1), MAX_CHARACTERS, "20000 characters"),
        ("+".join("x" * 1001), 2 * (MAX_OPERATORS + 1), "300 operators"),
        ("x " * 10000, 3, "unexpected 'x'"), ("x" + " " * 19998 + "?", 20000, "'?'"),
    ],
    ids=lambda value: str(value)[:12],
)  # fmt: skip
def test_faults_stand_at_their_column(text: str, column: int, says: str) -> None:
    fault = fault_of(text)
    assert fault.column == column
    assert says in fault.message


def test_names_in_braces_and_with_dots() -> None:
    text = "k_{each}*dir_{a}*({T} - {T0})"
    assert names(parse(text, name=BRACED)) == {"k_{each}": 1, "dir_{a}": 10, "{T}": 19, "{T0}": 25}
    assert names(parse("H1.x - H1_x*2.5", name=DOTTED)) == {"H1.x": 1, "H1_x": 8}
    assert to_text(parse(text, name=BRACED)) == text
    assert (fault_of("{a}*x").column, fault_of("a.b").column) == (1, 2)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("a-b-c", "a - b - c"), ("((a))*(b)", "a*b"), ("(-2)**x", "(-2)**x"), ("+x", "x"),
        ("x*0.1", "x*0.1"), ("exp((-x)/30)", "exp(-x/30)"), ("(-x)*y", "-x*y"),
        ("x - (-y)/2", "x - (-y/2)"), ("x*(-y)", "x*(-y)"),
    ],
)  # fmt: skip
def test_no_more_parentheses_than_needed(text: str, canonical: str) -> None:
    assert to_text(parse(text)) == canonical


# Evaluation.


def test_arrays_broadcast_and_what_is_not_finite_is_returned_without_a_warning() -> None:
    x, y = np.array([[1.0], [2.0]]), np.array([10.0, 20.0, 30.0])
    found = evaluate(parse("x*y + 1"), {"x": x, "y": y})
    np.testing.assert_array_equal(found, [[11, 21, 31], [21, 41, 61]])
    odd = evaluate(parse("sqrt(x) + log(x) + 1/x + x**0.5"), {"x": np.array([-1.0, 0.0, 1.0])})
    assert np.isfinite(np.asarray(odd)).tolist() == [False, False, True]
    assert evaluate(parse("n**-2"), {"n": np.array([2])}) == 0.25
    with pytest.raises(InputError, match="the value of 'b' is missing at column 5"):
        evaluate(parse("a + b"), {"a": 1.0})


@pytest.mark.parametrize(("u", "value"), [(-1e-300, 0.0), (0.0, 1.0), (-0.0, 1.0), (1e-300, 1.0)])
def test_step_is_one_from_zero_on(u: float, value: float) -> None:
    assert evaluate(parse("step(u)"), {"u": u}) == value
    found = evaluate(parse("step(u)"), {"u": np.array([u, math.nan])})
    np.testing.assert_array_equal(found, [value, math.nan])


# Linear forms.


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("x + a*b", 6, "'a' and 'b': their product"),
        ("a*a", 2, "'a' and 'a': their product"),
        ("b/a", 3, "'a': in a denominator"), ("x + a**2", 5, "'a': in a power"),
        ("2**(x*b)", 7, "'b': in a power"), ("-(y*(x - sqrt(a)))", 15, "'a': inside sqrt()"),
        ("1/(1/a)", 6, "'a': in a denominator"),
    ],
)  # fmt: skip
def test_what_is_not_linear_is_refused_at_its_column(text: str, column: int, says: str) -> None:
    with pytest.raises(InputError) as caught:
        linear_form(parse(text), "abc")
    (fault,) = caught.value.findings
    assert says in fault.text
    assert (fault.code, fault.column) == ("not-linear", column)
    assert fault.expected == "an equation that is linear in components and parameters"


# Derivatives of equations against formulas by hand, differences, and where there are none.


def at(text: str, **values: float) -> Derivatives:
    return derivatives(parse(text, BUDGET_FUNCTIONS), values, list(values))


S, C, TAN = math.sin(0.3), math.cos(0.3), math.tan(0.3)
# By hand, at x = 0.3: first, second and third derivative.
BY_HAND = {
    "x**-2": (-2 * 0.3**-3, 6 * 0.3**-4, -24 * 0.3**-5),
    "x**0.5": (0.5 * 0.3**-0.5, -0.25 * 0.3**-1.5, 0.375 * 0.3**-2.5),
    "sin(x)": (C, -S, -C),
    "cos(x)": (-S, -C, S),
    "tan(x)": (1 / C**2, 2 * TAN / C**2, (2 + 4 * S**2) / C**4),
    "asin(x)": (0.91**-0.5, 0.3 * 0.91**-1.5, (1 + 2 * 0.09) * 0.91**-2.5),
    "acos(x)": (-(0.91**-0.5), -0.3 * 0.91**-1.5, -(1 + 2 * 0.09) * 0.91**-2.5),
    "atan(x)": (1 / 1.09, -0.6 / 1.09**2, (6 * 0.09 - 2) / 1.09**3),
    "exp(2*x)": (2 * math.exp(0.6), 4 * math.exp(0.6), 8 * math.exp(0.6)),
    "log(x)": (1 / 0.3, -1 / 0.09, 2 / 0.027),
    "sqrt(x)": (0.5 * 0.3**-0.5, -0.25 * 0.3**-1.5, 0.375 * 0.3**-2.5),
    "abs(-3*x)": (3.0, 0.0, 0.0),
    "step(x)*x**2": (0.6, 2.0, 0.0),
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


# Each with what equals it nearby, where abs and step have no complex values.
EQUATIONS = {
    "3 - x/2 + 2*y": "",
    "-x*y - (y - x)*x": "",
    "x*y*z + x**2*y/z": "",
    "y/(1 + x**3)": "",
    "(1 + x)**y*2**x": "",
    "sin(x*y)*exp(-z)/(1 + x**2)": "",
    "cos(x) + log(x*y)*sqrt(1 + x*z)": "",
    "abs(x - 2)*y + abs(x)": "(2 - x)*y + x",
    "step(x)*x**3 + step(y)": "x**3 + 1",
}
CIRCLE = 0.1 * np.exp(2j * np.pi * np.arange(32) / 32)


@pytest.mark.parametrize("text", EQUATIONS)
@pytest.mark.parametrize("x", [0.3, 1.7])
def test_several_variables_against_integrals_of_cauchy(text: str, x: float) -> None:
    """Another method: k! times the mean of f/w^k for w on a circle about the point."""
    at, names, tree = {"x": x, "y": 0.8, "z": 0.4}, list("xyz"), parse(text)
    found = derivatives(tree, at, names)
    assert found.value == pytest.approx(float(evaluate(tree, at)), rel=1e-13)

    def mean(order: int, name: str, w: Any, **moved: Any) -> Any:
        values: dict[str, Any] = {**at, **moved}
        f = eval(EQUATIONS[text] or text, vars(np) | values | {name: values[name] + w})
        return math.factorial(order) * np.mean(f / w**order, axis=-1)

    for i, name in enumerate(names):
        assert found.first[i] == pytest.approx(mean(1, name, CIRCLE).real, rel=1e-12)
        for j, other in enumerate(names):
            w = CIRCLE[:, None]
            if i == j:
                second = mean(2, name, CIRCLE)
            else:
                second = np.mean(mean(1, name, CIRCLE, **{other: at[other] + w}) / CIRCLE)
            assert found.second[i, j] == pytest.approx(second.real, abs=1e-11)
        assert found.third[i] == pytest.approx(mean(3, name, CIRCLE).real, abs=1e-9)


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


# The unit algebra: equations of machines, and of numbers that are taken as they stand.


MM, RAD = internal(length=1), internal()
UNITS = dict.fromkeys(("x", "y", "z", "dx_x", "dy_y"), MM) | dict.fromkeys(("ey_x", "ez_y"), RAD)
COLUMNS = {"T": internal(degree=1), "t": internal(minute=1), "dir_x": RAD}


def faults_of(text: str, units: str = "") -> list[Finding]:
    """Of an equation of a machine, with parameters such as ``a um, b um/K``."""
    stated = (item.split() for item in units.split(", ") if item)
    parameters = {name: PARAMETER_UNITS[unit] for name, unit in stated}
    try:
        check_dimension(parse(text), MM, UNITS, parameters, COLUMNS)
    except InputError as error:
        return list(error.findings)
    return []


@pytest.mark.parametrize(
    "text",
    [
        "dx_x + z*ey_x - y*ez_y", "dx_x + arm*ey_x", "0.004*T", "dx_x + 0.01", "(x + 100)*ez_y",
        "dx_x*ey_x", "dx_x*sin(2*pi*x/25)", "dx_x*step(x - 300)", "dx_x*cos(ey_x)*exp(x/y)*log(2)",
        "dx_x*exp(-x/50)*(1 + x/500)*(1 - 0.002*y)", "dx_x*(x/500 - 1)", "sqrt(x**2 + y**2)*ey_x",
        "-(dx_x - z*ey_x)", "x**arm", "x**0.5", "sqrt(x)", "3", "unheard_of", "-x*-ey_x",
        "a*(T - 20): a um/K", "a*x*(T - 20): a um/m/K", "a*t: a um/h", "a*(T - 20)**2: a um",
        "a*2*(T - 20): a um", "a*dir_x + b*x: a um, b urad", "a*x*(T - 20)/10: a um/m",
        "a*x*exp(-t/30): a um/m", "a*user_column: a um",
    ],
)  # fmt: skip
def test_equations_of_lengths(text: str) -> None:
    """With the units of parameters after a colon."""
    equation, _, units = text.partition(": ")
    assert not faults_of(equation, units=units)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("dx_x + ey_x", [8]), ("dx_x - 127*ey_x", [8]), ("dx_x - (dy_y - ey_x/2)", [16]),
        ("-(dx_x + ey_x)", [10]), ("dx_x*z + ey_x", [1, 10]), ("step(x)", [1]), ("x**0", [1]),
        ("sqrt(x**2*y**2)", [1]), ("z*ey_x/y + dx_x", [1]), ("dx_x*y*-1", [1]),
        # Within a term.
        ("2*(dx_x + ey_x)", [9]), ("(x*y + x)/y", [6]), ("dx_x*sin(x)", [10]),
        ("dx_x*exp(-x)", [10]), ("dx_x*cos(x*y)", [10]), ("dx_x*2**x", [9]),
    ],
)  # fmt: skip
def test_what_is_no_length_is_named_where_it_begins(text: str, columns: list[int]) -> None:
    found = faults_of(text)
    assert [fault.column for fault in found] == columns
    assert {fault.code for fault in found} == {"wrong-unit"}


@pytest.mark.parametrize(
    ("text", "units", "expected"),
    [
        ("a*x", "a um", "a in um/m"), ("a*x*y", "a um/m", "a in um/m^2"),
        ("a*(T - 20)", "a um", "a in um/K"), ("a*x*(T - 20)", "a um/m", "a in um/m/K"),
        ("a", "a um/K", "a in um"), ("a*t*x", "a um/min", "a in um/m/min or um/m/h"),
        ("a*dir_x", "a um/m", "a in um"),
        ("a*(T + x)", "a um/K", "terms of one unit"),
    ],
)  # fmt: skip
def test_the_unit_that_a_parameter_should_have(text: str, units: str, expected: str) -> None:
    (fault,) = faults_of(text, units=units)
    assert fault.expected == expected


def consistency(text: str, result: str, **units: str) -> str | None:
    """The code of the fault of an equation whose names have these units."""
    texts = [*units.values(), result]
    named = {unit: unit_powers(unit) for unit in texts}
    known = {name: named[unit] for name, unit in units.items()}
    within, whole = check_consistent(parse(text, BUDGET_FUNCTIONS), known, named[result], named)
    found = [*within, *([whole] if whole else [])]
    assert len(found) <= 1
    return found[0].code if found else None


@pytest.mark.parametrize(
    ("text", "result", "units", "code"),
    [
        # JCGM 100, H.1: nanometres, and coefficients per degree.
        ("ls + d - ls*(a*t)", "nm", {"ls": "nm", "d": "nm", "a": "1/degC", "t": "degC"}, None),
        ("ls + d", "nm", {"ls": "mm", "d": "nm"}, "wrong-unit"),
        ("ls + t", "mm", {"ls": "mm", "t": "degC"}, "wrong-unit"),
        ("l*a*t", "um", {"l": "mm", "a": "ppm/K", "t": "K"}, "wrong-unit"),
        ("l*(1 + a*t)", "nm", {"l": "mm", "a": "um/m/K", "t": "K"}, "wrong-unit"),
        ("l*(1 + a*t/1000000)", "mm", {"l": "mm", "a": "um/m/K", "t": "K"}, None),
        ("a + 0.5", "mm", {"a": "mm"}, None),
        ("a + b - 90", "deg", {"a": "deg", "b": "deg"}, None),
        ("100 - p", "%", {"p": "%"}, None),
        ("n*p - 90", "deg", {"n": "1", "p": "deg"}, None),
        ("a*t - 90", "deg", {"a": "deg/K", "t": "K"}, None),
        ("p - 3", "mrad", {"p": "mrad"}, None),
        ("sqrt(p**2 + r**2) - 5", "urad", {"p": "urad", "r": "urad"}, None),
        ("abs(p) + 0.5", "mrad", {"p": "mrad"}, None),
        ("l*(1 + abs(a*t))", "mm", {"l": "mm", "a": "um/m/K", "t": "K"}, "wrong-unit"),
        ("1 + sqrt(e*f)", "1", {"e": "um/m", "f": "um/m"}, "wrong-unit"),
        ("1 + e*c", "1", {"e": "um/m", "c": "1"}, "wrong-unit"),
        ("l*(1 + a*t)", "mm", {"l": "mm", "a": "1/K", "t": "K"}, None),
        ("l*a*t/1000", "um", {"l": "mm", "a": "ppm/K", "t": "K"}, None),
        ("1000*V/I*cos(p)", "ohm", {"V": "V", "I": "mA", "p": "rad"}, None),
        ("cos(p)", "1", {"p": "deg"}, "wrong-unit"),
        ("cos(p - 90)", "1", {"p": "deg"}, "wrong-unit"),
        ("cos(p*pi/180)", "1", {"p": "deg"}, None),
        ("cos((p - 90)*pi/180)", "1", {"p": "deg"}, None),
        ("log(t + 273.15)", "1", {"t": "degC"}, None),
        ("exp(34 - 6292/T)", "Pa", {"T": "K"}, None),
        ("atan2(y, x)", "rad", {"y": "mm", "x": "um"}, "wrong-unit"),
        ("a + 2*b", "mm", {"a": "mm", "b": "furlong"}, None),
        ("(a + b)*(a - c)", "mm^2", {"a": "mm", "b": "mm", "c": "um"}, "wrong-unit"),
    ],
)
def test_numbers_that_are_taken_as_they_stand(
    text: str, result: str, units: dict[str, str], code: str | None
) -> None:
    assert consistency(text, result, **units) == code


@pytest.mark.parametrize(
    "text", ["1 + a*t + b*t", "a*t + b*t + 1", "1 - (a*t + b*t)", "-(a*t) + 1", "a*t + (1 + b*t)"]
)
@pytest.mark.parametrize("result", ["mm", "nm"])
def test_the_1_beside_an_expansion_is_named_where_it_stands(text: str, result: str) -> None:
    """Whatever the spelling, and though mm times um/m is nm."""
    units = {"l": "mm", "a": "um/m/K", "b": "um/m/K", "t": "K"}
    powers = {name: unit_powers(unit) for name, unit in units.items()}
    tree = parse(f"l*({text})", BUDGET_FUNCTIONS)
    (fault,), whole = check_consistent(tree, powers, unit_powers(result), {})
    assert whole is None
    assert fault.facts["of"] == "what is added to 1"
    assert "times 1e-06" in f"{fault.expected}"
    assert f"l*({text})"[int(fault.column or 0) - 1] in "+-"


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("1", "1"), ("um/m", "ppm"), ("um/m/K", "ppm/degC"), ("um/(m K)", "um/m/K"),
        ("kg m^2/s2", "J"), ("N/mm^2", "MPa"), ("\u00b5m", "um"), ("\u00b0C", "degC"),
        ("inch", "in"), ("N*m", "J"), ("1/\u00b0C", "K^-1"), ("m**2", "m\u00b2"), ("kV/mA", "Mohm"),
        ("hPa", "mbar"), ("V/A", "ohm"),
    ],
)  # fmt: skip
def test_units_that_are_one(text: str, same: str) -> None:
    found, other = unit_powers(text), unit_powers(same)
    assert found.known
    assert found.agrees(other)


@pytest.mark.parametrize("text", [None, "", " ", "g", "um/m*K", "furlong", "Grad", "mm!", "x" * 99])
def test_units_that_nobody_knows(text: str | None) -> None:
    assert unit_powers(text) == ANY
