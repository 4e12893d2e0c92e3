"""The equation language against Python's own, on random equations and random text."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mtu_cli.findings import InputError
from mtu_cli.language import Node, evaluate, linear_form, names, parse, to_text
from mtu_cli.language.tree import PRECEDENCE, Call, Name, Number, walk

VALUES = {"x": 1.3, "y": -0.7, "z": 2.9}
COMPONENTS = {"a": 0.31, "b": -1.7, "c": 2.3}
STEADY = settings(derandomize=True, deadline=None, database=None, max_examples=300)

numbers = st.floats(-9.0, 9.0).map(lambda value: Number(round(value, 2), 0))
operators = st.sampled_from(list(PRECEDENCE))


def grown(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.one_of(
        st.builds(Call, operators, st.tuples(inner, inner), st.just(0)),
        st.builds(Call, st.just("neg"), st.tuples(inner), st.just(0)),
        st.builds(
            lambda name, item: Call(name, (item,), 0),
            st.sampled_from(["sin", "cos", "exp", "log", "sqrt", "abs", "step"]),
            inner,
        ),
    )


leaves = st.one_of(numbers, st.sampled_from([Name(name, 0) for name in VALUES]))
trees: st.SearchStrategy[Node] = st.recursive(leaves, grown, max_leaves=12)


def bracketed(node: Node) -> str:
    """Python text with every operation in brackets: no rule of precedence is used."""
    match node:
        case Number(value):
            return f"F({value!r})"
        case Name(name):
            return name
        case Call("neg", (operand,)):
            return f"(-{bracketed(operand)})"
        case Call(sign, (left, right)):
            return f"({bracketed(left)}{sign}{bracketed(right)})"
        case Call(function, (argument,)):
            return f"{function}({bracketed(argument)})"
    raise AssertionError(node)


def python(text: str) -> float:
    """Python's value of the text, its literals taken as floats with IEEE infinities."""
    functions = {name: getattr(np, name) for name in ("sin", "cos", "exp", "log", "sqrt", "abs")}
    scope = {"F": np.float64, "step": lambda value: np.float64(not value < 0)} | functions
    scope |= {name: np.float64(value) for name, value in VALUES.items()}
    with np.errstate(all="ignore"):
        return float(eval(text, {"__builtins__": {}}, scope))


def tame(tree: Node) -> bool:
    """No intermediate value at which rounding decides the result."""
    found = [abs(float(evaluate(node, VALUES))) for node in walk(tree)]
    return all(math.isfinite(value) and (value == 0 or 1e-5 < value < 1e5) for value in found)


@STEADY
@given(trees)
def test_an_equation_is_what_python_makes_of_it_and_so_is_its_text(tree: Node) -> None:
    assume(tame(tree))
    wanted, text = python(bracketed(tree)), to_text(tree)
    assert math.isclose(float(evaluate(tree, VALUES)), wanted, rel_tol=1e-12, abs_tol=1e-12)
    assert math.isclose(float(evaluate(parse(text), VALUES)), wanted, rel_tol=1e-7, abs_tol=1e-7)
    again = to_text(parse(text))
    assert to_text(parse(again)) == again


factors = st.one_of(leaves, st.builds(lambda item: Call("cos", (item,), 0), leaves))


def linear_grown(inner: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    return st.one_of(
        st.builds(Call, st.sampled_from("+-"), st.tuples(inner, inner), st.just(0)),
        st.builds(Call, st.just("neg"), st.tuples(inner), st.just(0)),
        st.builds(Call, st.just("*"), st.tuples(factors, inner), st.just(0)),
        st.builds(Call, st.sampled_from("*/"), st.tuples(inner, factors), st.just(0)),
    )


linear_trees: st.SearchStrategy[Node] = st.recursive(
    st.one_of(factors, st.sampled_from([Name(name, 0) for name in COMPONENTS])),
    linear_grown,
    max_leaves=12,
)


@STEADY
@given(linear_trees)
def test_a_linear_form_reassembles_to_its_equation(tree: Node) -> None:
    known = VALUES | COMPONENTS
    wanted = float(evaluate(tree, known))
    assume(math.isfinite(wanted) and abs(wanted) < 1e6)
    form = linear_form(tree, COMPONENTS)
    parts = [
        float(evaluate(node, VALUES)) * COMPONENTS[name] for name, node in form.coefficients.items()
    ]
    if form.remainder is not None:
        assert not set(COMPONENTS) & set(names(form.remainder))
        parts.append(float(evaluate(form.remainder, VALUES)))
    assume(all(math.isfinite(part) and abs(part) < 1e6 for part in parts))
    assert set(form.coefficients) == set(COMPONENTS) & set(names(tree))
    assert math.isclose(math.fsum(parts), wanted, rel_tol=1e-8, abs_tol=1e-8)


@STEADY
@given(linear_trees)
def test_an_equation_is_refused_exactly_where_it_is_not_linear(tree: Node) -> None:
    """Squaring a linear equation that holds a component makes a product of components."""
    held = set(COMPONENTS) & set(names(tree))
    square = Call("*", (tree, tree), 77)
    if held:
        with pytest.raises(InputError, match="product") as caught:
            linear_form(square, COMPONENTS)
        assert caught.value.findings[0].column == 77
    else:
        assert linear_form(square, COMPONENTS).remainder == square
