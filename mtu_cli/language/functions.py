"""The functions and operators of equations, one table for all of the language; values of equations.

A function has its name in numpy, its derivative, and the rule by which units follow. Whoever adds
one adds a line here, and nothing elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from mtu_cli.findings import error
from mtu_cli.language.tree import Call, Name, Node, Number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Value = float | NDArray[np.float64]

UnitRule = Literal["number", "same", "alike", "product", "quotient", "power", "root", "any"]


class Function(NamedTuple):
    """A function of equations.

    `name` is that of numpy's, `slope` the derivative of one of one argument u as an equation.
    `unit`: what its arguments and value are: of a plain `number` a number, of one unit the `same`,
    of two `alike` a number, of `any` unit a number; the others say themselves.
    """

    name: str
    slope: str = ""
    unit: UnitRule = "number"
    arity: int = 1


MACHINE_FUNCTIONS: dict[str, Function] = {
    "sin": Function("sin", "cos(u)"),
    "cos": Function("cos", "-sin(u)"),
    "exp": Function("exp", "exp(u)"),
    "log": Function("log", "1/u"),
    "sqrt": Function("sqrt", "1/(2*sqrt(u))", "root"),
    "abs": Function("abs", "2*step(u) - 1", "same"),
    "step": Function("heaviside", "0", "any"),
}
"""`step(u)` is 0 for u < 0, else 1."""

BUDGET_FUNCTIONS: dict[str, Function] = MACHINE_FUNCTIONS | {
    "tan": Function("tan", "1 + tan(u)**2"),
    "asin": Function("arcsin", "1/sqrt(1 - u**2)"),
    "acos": Function("arccos", "-1/sqrt(1 - u**2)"),
    "atan": Function("arctan", "1/(1 + u**2)"),
    "atan2": Function("arctan2", unit="alike", arity=2),
}
"""Budgets and graphs know the other circular functions too."""

FUNCTIONS: dict[str, Function] = BUDGET_FUNCTIONS | {
    "+": Function("add", unit="same", arity=2),
    "-": Function("subtract", unit="same", arity=2),
    "neg": Function("negative", unit="same"),
    "*": Function("multiply", unit="product", arity=2),
    "/": Function("divide", unit="quotient", arity=2),
    "**": Function("power", unit="power", arity=2),
}
"""All that a `Call` of a tree may be; operators are written by their signs alone."""


@cache
def numpy_function(name: str) -> Callable[..., Any]:
    """An operator or function of floats or arrays."""
    import numpy as np

    if name == "step":  # numpy's keeps nan: what has no value has no side of 0
        return lambda u: np.heaviside(u, 1.0)
    if name == "**":  # numpy raises no negative integer to a power
        return lambda base, exponent: np.power(np.asarray(base, float), exponent)
    function: Callable[..., Any] = getattr(np, FUNCTIONS[name].name)
    return function


def finite_value(name: str, *operands: float) -> float | None:
    """The value of an operator or function, or None where it has no finite real value.

    >>> finite_value("sqrt", 4.0), finite_value("/", 1.0, 0.0)
    (2.0, None)
    """
    import numpy as np

    with np.errstate(all="ignore"):
        value = float(numpy_function(name)(*operands))
    return value if math.isfinite(value) else None


def evaluate(node: Node, values: Mapping[str, Value]) -> Value:
    """The equation's value for the given names; arrays broadcast as numpy does.

    Units are the internal ones (mm, rad, degC, min). A value that is not finite (a division
    by zero, the logarithm of a negative number) is returned as such: the caller knows the
    row it belongs to and reports it.

    Raises InputError for a name without a value.
    """
    import numpy as np

    with np.errstate(all="ignore"):
        value: Value = _value(node, values)
    return value


def _value(node: Node, values: Mapping[str, Value]) -> Any:
    match node:
        case Number(value):
            return value
        case Name(name, column):
            return value_of(name, values, column)
        case Call(function, arguments):
            return numpy_function(function)(*(_value(item, values) for item in arguments))


def value_of(name: str, values: Mapping[str, Any], column: int) -> Any:
    """The value of a name. Raises InputError where it has none."""
    if name not in values:
        raise error("missing-input", what=f"the value of '{name}'", column=column)
    return values[name]


def folded(node: Call) -> Node:
    """The number that an operation on numbers gives; any other as it is.

    Raises InputError where it has no finite real value.
    """
    operands = [item.value for item in node.arguments if isinstance(item, Number)]
    if len(operands) < len(node.arguments):
        return node
    if (value := finite_value(node.function, *operands)) is None:
        what = f"'{node.function}' of these constants"
        raise error("no-finite-value", what=what, where="", column=node.column)
    return Number(value, node.column)
