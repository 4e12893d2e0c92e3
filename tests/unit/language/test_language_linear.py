from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.findings import InputError
from mtu_cli.language import evaluate, linear_form, names, parse, to_text

COMPONENTS = ("a", "b", "c")


@pytest.mark.parametrize(
    ("text", "coefficients", "remainder"),
    [
        ("a", {"a": "1"}, None),
        ("-a", {"a": "-1"}, None),
        ("a + b - y*c", {"a": "1", "b": "1", "c": "-y"}, None),
        ("a - a", {"a": "1 + -1"}, None),
        ("x - (a - b)", {"a": "-1", "b": "1"}, "x"),
        ("x*y + 3", {}, "x*y + 3"),
        ("a/x", {"a": "1/x"}, None),
        ("(a + x)*y", {"a": "y"}, "x*y"),
        ("y*(a + x)/2", {"a": "y/2"}, "y*x/2"),
        ("-(x + a)", {"a": "-1"}, "-x"),
        ("a*2*pi", {"a": "2*3.141592653589793"}, None),
        ("sin(x)*a", {"a": "sin(x)"}, None),
        ("0*a", {"a": "0"}, None),
    ],
)
def test_linear_forms(text: str, coefficients: dict[str, str], remainder: str | None) -> None:
    form = linear_form(parse(text), COMPONENTS)
    assert {name: to_text(node) for name, node in form.coefficients.items()} == coefficients
    assert (None if form.remainder is None else to_text(form.remainder)) == remainder


def test_the_machine_of_gilsinn_and_ling() -> None:
    """Eq. (1): the lever arms of Ex, differenced numerically."""
    equation = "dx_x + dx_y + z*ey_x + y*ez_x + z*ey_y + y*ez_y - y*axy"
    components = ["dx_x", "dx_y", "ey_x", "ez_x", "ey_y", "ez_y", "axy"]
    node = parse(equation)
    form = linear_form(node, components)
    at = {"x": 3.0, "y": 5.0, "z": 127.0}
    base = dict.fromkeys(components, 0.0) | at
    for name in components:
        lever = evaluate(node, base | {name: 1.0}) - evaluate(node, base)
        assert evaluate(form.coefficients[name], at) == lever
    assert form.remainder is None


@pytest.mark.parametrize(
    ("text", "column", "says"),
    [
        ("x + a*b", 6, "the component 'a' and the component 'b': their product"),
        ("(x + a)*(y - c)", 8, "the component 'a' and the component 'c': their product"),
        ("a*a", 2, "the component 'a' and the component 'a': their product"),
        ("x/(y + a)", 8, "'a'"),
        ("b/a", 3, "'a': in a denominator"),
        ("x + a**2", 5, "'a': in a power"),
        ("2**(x*b)", 7, "'b': in a power"),
        ("x**a", 4, "'a': in a power"),
        ("1 + sin(x + c)", 13, "'c': inside sin()"),
        ("x*abs(b + a)", 7, "'b': inside abs()"),
        ("-(y*(x - sqrt(a)))", 15, "'a': inside sqrt()"),
        ("step(x)*step(a)", 14, "'a': inside step()"),
        ("1/(1/a)", 6, "'a': in a denominator"),
    ],
)
def test_what_is_not_linear_is_refused_at_its_column(text: str, column: int, says: str) -> None:
    with pytest.raises(InputError) as caught:
        linear_form(parse(text), COMPONENTS)
    (fault,) = caught.value.findings
    assert says in fault.text
    assert (fault.code, fault.column) == ("not-linear", column)
    assert fault.expected == "an equation that is linear in the components"


def test_coefficients_evaluate_over_arrays() -> None:
    form = linear_form(parse("y*(a - x) + a/2"), ["a"])
    x, y = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    assert form.remainder is not None
    assert not {"a"} & (set(names(form.coefficients["a"])) | set(names(form.remainder)))
    np.testing.assert_allclose(evaluate(form.coefficients["a"], {"x": x, "y": y}), y + 0.5)
    np.testing.assert_allclose(evaluate(form.remainder, {"x": x, "y": y}), -x * y)
