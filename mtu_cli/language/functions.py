"""The functions of equations: one table from which every part of the language reads."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Literal, NamedTuple

Slopes = Callable[[float], list[float]]
UnitRule = Literal["number", "same", "root", "alike", "any"]
ORDER = 3
"""Derivatives are known to this order."""


class Function(NamedTuple):
    """A function of equations.

    `scalar` is its value at floats, `array` the name of numpy's (with `extra` last arguments),
    `slopes` gives the first to third derivative of one of one argument, nan where there is none.
    `unit`: what its arguments and value are: of a plain `number` a number, of the `same` unit, the
    square `root` of one, of two `alike` a number, of `any` unit a number.
    """

    scalar: Callable[..., float]
    array: str
    slopes: Slopes | None
    unit: UnitRule = "number"
    arity: int = 1
    extra: tuple[float, ...] = ()


def _tan(x: float) -> list[float]:
    t = math.tan(x)
    q = 1.0 + t * t
    return [q, 2.0 * t * q, 2.0 * q * (1.0 + 3.0 * t * t)]


def _asin(x: float) -> list[float]:
    q = 1.0 - x * x
    if q <= 0.0:
        return [math.nan] * ORDER
    return [q**-0.5, x * q**-1.5, (1.0 + 2.0 * x * x) * q**-2.5]


def _acos(x: float) -> list[float]:
    return [-slope for slope in _asin(x)]


def _atan(x: float) -> list[float]:
    q = 1.0 / (1.0 + x * x)
    return [q, -2.0 * x * q**2, (6.0 * x * x - 2.0) * q**3]


def _sqrt(x: float) -> list[float]:
    return [0.5 * x**-0.5, -0.25 * x**-1.5, 0.375 * x**-2.5] if x > 0.0 else [math.nan] * ORDER


def _log(x: float) -> list[float]:
    # Powers of 1/x overflow to inf; powers of x would vanish, and nothing divides by 0.
    return [1.0 / x, -((1.0 / x) ** 2), 2.0 * (1.0 / x) ** 3]


def _abs(x: float) -> list[float]:
    return [math.copysign(1.0, x) if x else math.nan, 0.0, 0.0]


def _step(x: float) -> list[float]:
    return [0.0 if x else math.nan, 0.0, 0.0]


MACHINE_FUNCTIONS: dict[str, Function] = {
    "sin": Function(math.sin, "sin", lambda x: [math.cos(x), -math.sin(x), -math.cos(x)]),
    "cos": Function(math.cos, "cos", lambda x: [-math.sin(x), -math.cos(x), math.sin(x)]),
    "exp": Function(math.exp, "exp", lambda x: [math.exp(x)] * ORDER),
    "log": Function(math.log, "log", _log),
    "sqrt": Function(math.sqrt, "sqrt", _sqrt, "root"),
    "abs": Function(abs, "abs", _abs, "same"),
    # numpy's keeps nan: what has no value has no side of 0.
    "step": Function(lambda x: 0.0 if x < 0 else 1.0, "heaviside", _step, "any", extra=(1.0,)),
}
"""`step(u)` is 0 for u < 0, else 1."""

BUDGET_FUNCTIONS: dict[str, Function] = MACHINE_FUNCTIONS | {
    "tan": Function(math.tan, "tan", _tan),
    "asin": Function(math.asin, "arcsin", _asin),
    "acos": Function(math.acos, "arccos", _acos),
    "atan": Function(math.atan, "arctan", _atan),
    "atan2": Function(math.atan2, "arctan2", None, "alike", arity=2),
}
"""Budgets and graphs know the other circular functions too."""

OPERATORS: dict[str, tuple[Callable[..., float], str]] = {
    "+": (operator.add, "add"),
    "-": (operator.sub, "subtract"),
    "*": (operator.mul, "multiply"),
    "/": (operator.truediv, "divide"),
    "**": (operator.pow, "power"),
}
"""On floats, and the name of numpy's."""


def apply_scalar(name: str, operands: tuple[float, ...]) -> float | None:
    """The value of an operator or function, or None where it has no finite real value.

    >>> apply_scalar("sqrt", (4.0,)), apply_scalar("/", (1.0, 0.0))
    (2.0, None)
    """
    apply = OPERATORS[name][0] if name in OPERATORS else BUDGET_FUNCTIONS[name].scalar
    try:
        value = apply(*operands)
    except (ArithmeticError, ValueError):
        return None
    if isinstance(value, complex) or not math.isfinite(value):
        return None
    return float(value)
