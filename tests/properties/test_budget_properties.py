"""Budgets under what must not matter: units, the order of inputs, correlations of nothing."""

from __future__ import annotations

import numpy as np
import pytest
from budget_examples import loaded
from hypothesis import given, settings
from hypothesis import strategies as st

from mtu_cli.analyses.budget import FirstOrder, first_order
from mtu_cli.analyses.budget.inputs import inputs_of

positive = st.floats(0.01, 10.0)
signed = st.floats(-5.0, 5.0)
numbers = st.tuples(signed, signed, signed, positive, positive, positive, st.floats(-0.9, 0.9))


def output(text: str) -> FirstOrder:
    file = loaded(text)
    (found,) = first_order(file, inputs_of(file))
    return found


def budget(values: tuple[float, ...], order: str = "abc", scale: float = 1.0) -> str:
    x = dict(zip("abc", values[:3], strict=True))
    u = dict(zip("abc", values[3:6], strict=True))
    x["a"], u["a"] = x["a"] * scale, u["a"] * scale
    rows = "".join(f"  {n}: {{value: {x[n]!r}, u: {u[n]!r}, dof: 7}}\n" for n in order)
    equation = f"equation: (a/{scale!r})*b + exp(c/5)*(a/{scale!r}) + b**2\n"
    return equation + "inputs:\n" + rows + f"correlations: [[a, b, {values[6]!r}]]\n"


@given(numbers, st.sampled_from(["acb", "bca", "cba"]))
@settings(max_examples=40, deadline=None)
def test_the_order_of_inputs_does_not_matter(values: tuple[float, ...], order: str) -> None:
    first, other = output(budget(values)), output(budget(values, order))
    assert other.u == pytest.approx(first.u)
    assert other.second_u == pytest.approx(first.second_u)
    assert other.dof == pytest.approx(first.dof)


@given(numbers, st.sampled_from([1e-6, 1e-3, 25.4, 1e9]))
@settings(max_examples=40, deadline=None)
def test_the_unit_of_an_input_does_not_matter(values: tuple[float, ...], scale: float) -> None:
    first, other = output(budget(values)), output(budget(values, scale=scale))
    assert other.u == pytest.approx(first.u)
    assert other.second_u == pytest.approx(first.second_u, rel=1e-5)
    assert np.nan_to_num(other.share) == pytest.approx(np.nan_to_num(first.share), abs=1e-8)
    if first.u > 0.0:
        assert float(first.share.sum()) == pytest.approx(1.0)
