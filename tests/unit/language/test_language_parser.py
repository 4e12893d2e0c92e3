from __future__ import annotations

import time

import pytest

from mtu_cli.findings import Finding, InputError
from mtu_cli.language import check_dimension, evaluate, linear_form, names, parse, to_text
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import BRACED, DOTTED, MAX_CHARACTERS, MAX_DEPTH, MAX_OPERATORS
from mtu_cli.language.tree import Call, Name, Number
from mtu_cli.units import internal

SECONDS = 1.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-x**2", -9.0),
        ("(-x)**2", 9.0),
        ("-2**2", -4.0),
        ("(-2)**2", 4.0),
        ("2**3**2", 512.0),
        ("(2**3)**2", 64.0),
        ("2**-1", 0.5),
        ("2**-x", 0.125),
        ("10-4-3", 3.0),
        ("10-(4-3)", 9.0),
        ("7/x*3", 7.0),
        ("7/(x*3)", 7 / 9),
        ("24/2/3", 4.0),
        ("2+3*4", 14.0),
        ("(2+3)*4", 20.0),
        ("2*-x", -6.0),
        ("--x", 3.0),
        ("-+-x", 3.0),
        ("- x * x", -9.0),
        ("x - -x", 6.0),
        (".5 + 5. + 1e1 + 1E-1 + 2.5e+0", 18.1),
        ("2*pi", 6.283185307179586),
        ("abs(-x) + sqrt(16)", 7.0),
        ("\tx\n+ 1 ", 4.0),
    ],
)
def test_precedence_and_grouping(text: str, value: float) -> None:
    assert evaluate(parse(text), {"x": 3.0}) == pytest.approx(value, rel=1e-15)


def test_columns_of_the_tree() -> None:
    assert parse("a - sin( -b)") == Call(
        "-", (Name("a", 1), Call("sin", (Call("neg", (Name("b", 11),), 10),), 5)), 3
    )


def test_constants_are_folded_where_they_stand() -> None:
    node = parse("x + 2*3")
    assert node == Call("+", (Name("x", 1), Number(6.0, 6)), 3)


def fault_of(text: str) -> Finding:
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        parse(text)
    assert time.process_time() - start < SECONDS
    (fault,) = caught.value.findings
    return fault


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("", 1, "unexpected end"),
        ("   ", 1, "unexpected end"),
        ("\n\t", 1, "unexpected end"),
        ("1..2", 3, "unexpected '.2'"),
        ("1e", 2, "unexpected 'e'"),
        ("1_000", 2, "unexpected '_000'"),
        ("x y", 3, "unexpected 'y'"),
        ("2x", 2, "unexpected 'x'"),
        ("x +", 4, "unexpected end"),
        ("x * / y", 5, "unexpected '/'"),
        ("(x + 1", 7, "'(' at column 1"),
        ("x + (y * (2 + 1)", 17, "'(' at column 5"),
        ("x + 1)", 6, "unexpected ')'"),
        ("()", 2, "unexpected ')'"),
        ("sin x", 1, "sin has 0 arguments"),
        ("sin()", 5, "unexpected ')'"),
        ("sin(1, 2)", 1, "2 arguments"),
        ("x, y", 2, "unexpected ','"),
        ("x = 1", 3, "'='"),
        ("x & y", 3, "'&'"),
        ("x // y", 4, "unexpected '/'"),
        ("3 ^ 2", 3, "'^'"),
        ("x[0]", 2, "'['"),
        ("x.real", 2, "'.'"),
        ("lambda: 0", 7, "':'"),
        ("'x'", 1, '"\'"'),
        ("x + µ", 5, "'µ'"),
        ("x × 2", 3, "'×'"),
        ("x² + 1", 2, "'²'"),
        ("٣ + x", 1, "'٣'"),
        ("２*x", 1, "'２'"),
        ("x \u2212 1", 3, "'\u2212'"),
        ("x\x00", 2, r"\x00"),
        ("1/0", 2, "no finite value"),
        ("x + 0**-1", 6, "no finite value"),
        ("log(0)", 1, "no finite value"),
        ("sqrt(-1) + x", 1, "no finite value"),
        ("(-8)**0.5", 5, "no finite value"),
        ("exp(1000)", 1, "no finite value"),
        ("9**9**9**9", 5, "no finite value"),
        ("x*1e999", 3, "not a finite number"),
        ("__import__('os')", 12, "'"),
        ("__import__(os)", 1, "unknown function at column 1: '__import__'"),
        ("eval(x)", 1, "unknown function at column 1: 'eval'"),
        ("pi(2)", 1, "unknown function at column 1: 'pi'"),
    ],
)
def test_faults_stand_at_their_column(text: str, column: int, says: str) -> None:
    error = fault_of(text)
    assert error.column == column
    assert says in error.message


@pytest.mark.parametrize(
    ("text", "expected"),
    [("x^2", "** for a power"), ("2 x", "an operator, such as * between factors"),
     ("(x)(y)", "an operator, such as *"), ("x)", "an operator or the end")],
)  # fmt: skip
def test_what_is_written_otherwise_elsewhere_is_told(text: str, expected: str) -> None:
    assert (fault_of(text).expected or "").startswith(expected)


def test_an_unknown_function_names_the_closest() -> None:
    error = fault_of("x + sine(y)")
    assert (error.code, error.column, error.meant) == ("unknown-name", 5, ("sin",))
    assert "sqrt" in (fault_of("zzz(y)").expected or "")


def test_budgets_know_more_functions_than_machines() -> None:
    assert fault_of("atan2(x, y)").column == 1
    assert evaluate(parse("atan2(1, x)", BUDGET_FUNCTIONS), {"x": 1.0}) == pytest.approx(0.7853981)
    with pytest.raises(InputError, match="atan2 has 1 arguments"):
        parse("atan2(x)", BUDGET_FUNCTIONS)


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("(" * 5000 + "x" + ")" * 5000, MAX_DEPTH + 1, "levels"),
        ("sin(" * 3900 + "x" + ")" * 3900, 4 * MAX_DEPTH + 1, "levels"),
        ("-" * 200 + "x", MAX_DEPTH + 1, "levels"),
        ("**".join("x" * 200), 3 * MAX_DEPTH + 1, "levels"),
        ("x" * (MAX_CHARACTERS + 1), MAX_CHARACTERS, "20000 characters"),
        ("(" * (MAX_CHARACTERS + 1), MAX_CHARACTERS, "20000 characters"),
        ("+".join("x" * 1001), 2 * (MAX_OPERATORS + 1), "300 operators"),
        ("-" * 20000, MAX_OPERATORS + 1, "300 operators"),
        ("x " * 10000, 3, "unexpected 'x'"),
        ("1. " * 6000, 4, "unexpected '1.'"),
        (" " * 19999 + "?", 20000, "'?'"),
        ("x" + " " * 19998 + "?", 20000, "'?'"),
    ],
    ids=lambda value: str(value)[:12],
)
def test_size_is_bounded_and_the_answer_quick(text: str, column: int, says: str) -> None:
    error = fault_of(text)
    assert error.column == column
    assert says in error.message


@pytest.mark.parametrize(
    "text",
    [
        "x" * MAX_CHARACTERS,
        "+".join(["x"] * (MAX_OPERATORS + 1)),
        "*".join(["x"] * (MAX_OPERATORS + 1)),
        "(" * (MAX_DEPTH - 1) + "x" + ")" * (MAX_DEPTH - 1),
        "**".join(["x"] * MAX_DEPTH),
    ],
    ids=["name", "sum", "product", "brackets", "powers"],
)
def test_the_largest_equations_are_usable(text: str) -> None:
    node = parse(text)
    name = next(iter(names(node)))
    assert evaluate(node, {name: 1.0}) in (1.0, MAX_OPERATORS + 1.0)
    assert to_text(parse(to_text(node))) == to_text(node)
    assert linear_form(node, ["other"]).remainder == node
    check_dimension(node, internal(), {name: internal()})


def test_a_sum_of_components_of_the_largest_size_is_linear() -> None:
    text = "+".join(f"c{i}" for i in range(MAX_OPERATORS + 1))
    form = linear_form(parse(text), [f"c{i}" for i in range(MAX_OPERATORS + 1)])
    assert len(form.coefficients) == MAX_OPERATORS + 1
    assert form.remainder is None


def test_names_in_braces_and_with_dots() -> None:
    text = "k_{each}*dir_{a}*({T} - {T0})"
    assert names(parse(text, name=BRACED)) == {"k_{each}": 1, "dir_{a}": 10, "{T}": 19, "{T0}": 25}
    assert names(parse("H1.x - H1_x*2.5", name=DOTTED)) == {"H1.x": 1, "H1_x": 8}
    assert to_text(parse(text, name=BRACED)) == text
    assert (fault_of("{a}*x").column, fault_of("a.b").column) == (1, 2)


def test_a_fault_stands_in_its_file() -> None:
    fault = fault_of("x + sine(y)").at(file="m.yaml", line=4, path="equations.Ex")
    assert str(fault) == (
        "m.yaml:4: equations.Ex: unknown function at column 5: 'sine'; did you mean 'sin'?"
    )
