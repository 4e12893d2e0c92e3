"""Equations read, written, evaluated and split: what `tests/properties` cannot say of them."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from mtu_cli.findings import Finding, InputError
from mtu_cli.language import (
    evaluate,
    linear_form,
    names,
    parse,
    to_text,
)
from mtu_cli.language.functions import BUDGET_FUNCTIONS, apply_scalar
from mtu_cli.language.parser import BRACED, DOTTED, MAX_CHARACTERS, MAX_DEPTH, MAX_OPERATORS
from mtu_cli.language.tree import Call, Name, Number

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
        ("-" * 200 + "x", MAX_DEPTH + 1, "levels"),
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
    assert evaluate(parse("step(u)"), {"u": u}) == apply_scalar("step", (u,)) == value
    found = evaluate(parse("step(u)"), {"u": np.array([u, math.nan])})
    np.testing.assert_array_equal(found, [value, math.nan])


@pytest.mark.parametrize("name", sorted(BUDGET_FUNCTIONS))
def test_folded_constants_agree_with_arrays(name: str) -> None:
    """The functions exist twice, on floats and on arrays; they must be the same functions."""
    for first in (-0.7, 0.0, 0.3, 1.0):
        operands = (first, 0.6)[: BUDGET_FUNCTIONS[name].arity]
        call = parse(f"{name}({', '.join('ab'[: len(operands)])})", BUDGET_FUNCTIONS)
        found = float(evaluate(call, dict(zip("ab", operands, strict=False))))
        folded = apply_scalar(name, operands)
        if folded is None:
            assert not math.isfinite(found)
        else:
            assert found == pytest.approx(folded, rel=1e-14, abs=1e-300)


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
