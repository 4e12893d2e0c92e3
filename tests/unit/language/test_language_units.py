"""The unit algebra: equations of machines, and of numbers that are taken as they stand."""

from __future__ import annotations

import pytest

from mtu_cli.findings import Finding, InputError
from mtu_cli.language import check_dimension, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.unit_algebra import check_consistent
from mtu_cli.units import ANY, PARAMETER_UNITS, internal, unit_powers

MM, RAD = internal(length=1), internal()
UNITS = dict.fromkeys(("x", "y", "z", "dx_x", "dy_y"), MM) | dict.fromkeys(("ey_x", "ez_y"), RAD)
COLUMNS = {"T": internal(degree=1), "t": internal(minute=1), "dir_x": RAD}


def faults_of(text: str, units: str = "") -> list[Finding]:
    """Of an equation of a machine, with parameters such as ``a um, b um/K``."""
    stated = (item.split() for item in units.split(", ") if item)
    parameters = {name: PARAMETER_UNITS[unit] for name, unit in stated}
    try:
        check_dimension(parse(text), MM, UNITS, parameters=parameters, columns=COLUMNS)
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
    "text",
    ["1 + a*t + b*t", "a*t + b*t + 1", "1 - (a*t + b*t)", "-(a*t) + 1", "a*t + (1 + b*t)"],
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
