"""Derivatives as equations against derivatives at a point, of every function of the language."""

from __future__ import annotations

import pytest

from mtu_cli.language import evaluate, parse, to_text
from mtu_cli.language.derivative import derivatives
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.slope import slope

EQUATIONS = [
    "3 - x/2 + 2*y",
    "-x*y - (y - x)*x",
    "y/(1 + x**3)",
    "(1 + x)**y*2**x",
    "y*sin(2*x)*exp(-x/3)",
    "cos(x) + log(x*y)*sqrt(1 + x)",
    "abs(x - 2)*y + abs(x)",
    "step(x - 1)*x + step(y)",
]


@pytest.mark.parametrize("text", EQUATIONS)
def test_the_derivative_of_an_equation_is_an_equation(text: str) -> None:
    for x in (0.3, 1.7):
        at = {"x": x, "y": 0.8}
        found = slope(parse(text), "x")
        assert parse(to_text(found)) is not None
        expected = derivatives(parse(text), at, ["x"]).first[0]
        assert evaluate(parse(to_text(found)), at) == pytest.approx(expected, rel=1e-12)


def test_every_function_has_one() -> None:
    assert all(any(f"{name}(" in text for text in EQUATIONS) for name in MACHINE_FUNCTIONS)
