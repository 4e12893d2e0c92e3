"""The equation language at its bounds: no text and no number makes it fail or linger."""

import math

import numpy as np
from fuzz.extremes import EQUATION_PIECES
from fuzz.messages import unclean
from fuzz.readers import within_time
from hypothesis import assume, example, given
from hypothesis import strategies as st
from property_settings import tried

from mtu_cli.findings import Finding, InputError
from mtu_cli.language import Node, check_dimension, evaluate, linear_form, names, parse, to_text
from mtu_cli.language.derivative import derivatives
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.units import internal

UNITS = {"a": internal(1), "b": internal(), "x": internal(1)}
KNOWN = ("a", "b", "x", "y")
PIECES = (*EQUATION_PIECES, *KNOWN, *(f"{name}(" for name in BUDGET_FUNCTIONS), ")", "2", "+", "*")
pieces = st.lists(st.sampled_from(PIECES), max_size=25).map("".join)
extremes = st.one_of(
    st.floats(),
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e308, -1e308, 5e-324, math.inf, math.nan, math.pi / 2]),
)

terms = st.recursive(
    st.one_of(st.sampled_from(KNOWN), st.sampled_from(["2", "0", "1e300", "0.5", "pi"])),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "**"]), inner).map(
            lambda found: f"({''.join(found)})"
        ),
        inner.map(lambda text: f"(-{text})"),
        st.tuples(
            st.sampled_from([name for name, item in BUDGET_FUNCTIONS.items() if item.arity == 1]),
            inner,
        ).map(lambda found: f"{found[0]}({found[1]})"),
        st.tuples(inner, inner).map(lambda found: f"atan2({found[0]}, {found[1]})"),
    ),
    max_leaves=10,
)


def parsed(text: str) -> Node | None:
    fault: Finding
    try:
        return parse(text, BUDGET_FUNCTIONS)
    except InputError as error:
        (fault,) = error.findings
    assert isinstance(fault.column, int)
    assert 1 <= fault.column <= len(text) + 1
    assert unclean(str(fault.at(file="m.yaml"))) is None
    return None


@tried(300)
@given(text=pieces, times=st.sampled_from([1, 1, 1, 2, 50, 3000]))
def test_any_words_are_an_equation_or_a_fault_with_its_column(text: str, times: int) -> None:
    with within_time():
        node = parsed(text * times)
        if node is not None:
            assert names(parse(to_text(node), BUDGET_FUNCTIONS)).keys() == names(node).keys()


@tried(200)
@given(text=terms, values=st.tuples(*[extremes] * 4))
def test_extreme_values_give_a_value_or_none(text: str, values: tuple[float, ...]) -> None:
    """Warnings are errors here: a division by zero is no word of numpy on the user's screen."""
    node = parsed(text)
    assume(node is not None)
    assert node is not None
    given_values = dict(zip(KNOWN, values, strict=True))
    single = evaluate(node, given_values)
    rows = {name: np.full(3, value) for name, value in given_values.items()}
    np.testing.assert_array_equal(np.broadcast_to(evaluate(node, rows), 3), np.full(3, single))


@tried(200)
@example(text="log(b)", values=(0.0, 1.0e-289, 0.0, 0.0))
@given(text=terms, values=st.tuples(*[extremes] * 4))
def test_derivatives_at_extreme_values(text: str, values: tuple[float, ...]) -> None:
    node = parsed(text)
    assume(node is not None)
    assert node is not None
    try:
        found = derivatives(node, dict(zip(KNOWN, values, strict=True)), KNOWN)
    except OverflowError:
        # The command says that a number is too large to calculate with.
        return
    assert found.first.shape == found.third.shape == (4,)
    assert found.second.shape == (4, 4)


@tried(200)
@given(text=terms, linear=st.sets(st.sampled_from(KNOWN)), wanted=st.integers(-1, 3))
def test_forms_and_dimensions_are_told_or_refused(text: str, linear: set[str], wanted: int) -> None:
    node = parsed(text)
    assume(node is not None)
    assert node is not None
    told = ["linear"]
    for check in (
        lambda found: linear_form(found, linear),
        lambda found: check_dimension(found, internal(wanted), UNITS, {}, {}),
    ):
        try:
            check(node)
        except InputError as error:
            told += [str(each.at(file="m.yaml")) for each in error.findings]
    assert unclean("\n".join(told)) is None
