from __future__ import annotations

import math

import numpy as np
import pytest

from mtu_cli.findings import InputError
from mtu_cli.language import evaluate, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS, apply_scalar


def test_arrays_broadcast() -> None:
    x = np.array([[1.0], [2.0]])
    y = np.array([10.0, 20.0, 30.0])
    found = evaluate(parse("x*y + 1"), {"x": x, "y": y})
    np.testing.assert_array_equal(found, [[11, 21, 31], [21, 41, 61]])


@pytest.mark.parametrize(
    ("u", "value"), [(-1e-300, 0.0), (0.0, 1.0), (-0.0, 1.0), (1e-300, 1.0), (-5.0, 0.0)]
)
def test_step_is_one_from_zero_on(u: float, value: float) -> None:
    assert evaluate(parse("step(u)"), {"u": u}) == value
    assert apply_scalar("step", (u,)) == value
    np.testing.assert_array_equal(evaluate(parse("step(u)"), {"u": np.array([u, u])}), [value] * 2)


def test_step_of_what_has_no_value_has_none() -> None:
    found = np.asarray(evaluate(parse("step(1 - sqrt(x))"), {"x": np.array([-1.0, 0.5, 4.0])}))
    np.testing.assert_array_equal(found, [np.nan, 1.0, 0.0])


def test_step_of_a_literal() -> None:
    assert evaluate(parse("step(0)"), {}) == 1.0


def test_what_is_not_finite_is_returned_without_a_warning() -> None:
    found = np.asarray(
        evaluate(parse("sqrt(x) + log(x) + 1/x + x**0.5"), {"x": np.array([-1.0, 0.0, 1.0])})
    )
    assert np.isnan(found[0])
    assert not np.isfinite(found[1])
    assert found[2] == 3.0
    assert math.isinf(float(evaluate(parse("1/x"), {"x": 0.0})))


def test_integers_to_negative_powers() -> None:
    assert evaluate(parse("n**-2"), {"n": np.array([2])}) == 0.25


def test_a_name_without_a_value() -> None:
    with pytest.raises(InputError, match="the value of 'b' is missing") as caught:
        evaluate(parse("a + b"), {"a": 1.0})
    assert caught.value.findings[0].column == 5


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
