"""Derivatives of the functions of one argument that equations know."""

from __future__ import annotations

import math
from collections.abc import Callable

ORDER = 3


def _tan(x: float) -> list[float]:
    t = math.tan(x)
    q = 1.0 + t * t
    return [q, 2.0 * t * q, 2.0 * q * (1.0 + 3.0 * t * t)]


def _asin(x: float) -> list[float]:
    q = 1.0 - x * x
    if q <= 0.0:
        return [math.nan] * ORDER
    return [q**-0.5, x * q**-1.5, (1.0 + 2.0 * x * x) * q**-2.5]


def _atan(x: float) -> list[float]:
    q = 1.0 / (1.0 + x * x)
    return [q, -2.0 * x * q**2, (6.0 * x * x - 2.0) * q**3]


def _sqrt(x: float) -> list[float]:
    return [0.5 * x**-0.5, -0.25 * x**-1.5, 0.375 * x**-2.5] if x > 0.0 else [math.nan] * ORDER


def _constant_sides(slope: float) -> list[float]:
    return [slope, 0.0, 0.0]


SLOPES: dict[str, Callable[[float], list[float]]] = {
    "sin": lambda x: [math.cos(x), -math.sin(x), -math.cos(x)],
    "cos": lambda x: [-math.sin(x), -math.cos(x), math.sin(x)],
    "tan": _tan,
    "asin": _asin,
    "acos": lambda x: [-slope for slope in _asin(x)],
    "atan": _atan,
    "exp": lambda x: [math.exp(x)] * ORDER,
    # Of a power of 1/x what is too large is told; one of x may be lost, and nothing divides by 0.
    "log": lambda x: [1.0 / x, -((1.0 / x) ** 2), 2.0 * (1.0 / x) ** 3],
    "sqrt": _sqrt,
    "abs": lambda x: _constant_sides(math.copysign(1.0, x) if x else math.nan),
    "step": lambda x: _constant_sides(0.0 if x else math.nan),
}
"""First to third derivative; nan where there is none: abs and step at 0, sqrt at 0."""
