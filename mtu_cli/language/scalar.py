"""Operators and functions on plain floats, for constants that stand in an equation."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable

SCALAR: dict[str, Callable[..., float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "step": lambda value: 0.0 if value < 0 else 1.0,
}


def apply_scalar(name: str, operands: tuple[float, ...]) -> float | None:
    """The value of an operator or function, or None where it has no finite real value."""
    try:
        value = SCALAR[name](*operands)
    except (ArithmeticError, ValueError):
        return None
    if isinstance(value, complex) or not math.isfinite(value):
        return None
    return float(value)
