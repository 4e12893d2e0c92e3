"""The value of an equation over arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from mtu_cli.language.errors import EquationError
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Value = float | NDArray[np.float64]


def evaluate(node: Node, values: Mapping[str, Value]) -> Value:
    """The equation's value for the given names; arrays broadcast as numpy does.

    Units are the internal ones (mm, rad, degC, min). A value that is not finite (a division
    by zero, the logarithm of a negative number) is returned as such: the caller knows the
    row it belongs to and reports it.

    Raises EquationError for a name without a value.
    """
    import numpy as np

    with np.errstate(all="ignore"):
        value: Value = _value(node, values, _numpy_functions())
    return value


def _value(node: Node, values: Mapping[str, Value], functions: Mapping[str, Any]) -> Any:
    match node:
        case Number(value):
            return value
        case Name(name, column):
            if name not in values:
                raise EquationError(f"{name!r} has no value", column)
            return values[name]
        case Negative(operand):
            return -_value(operand, values, functions)
        case Binary(operator, left, right):
            return functions[operator](
                _value(left, values, functions), _value(right, values, functions)
            )
        case Call(function, arguments):
            return functions[function](*(_value(item, values, functions) for item in arguments))


def _numpy_functions() -> Mapping[str, Callable[..., Any]]:
    import numpy as np

    return {
        "+": np.add,
        "-": np.subtract,
        "*": np.multiply,
        "/": np.divide,
        "**": lambda base, exponent: np.power(np.asarray(base, float), exponent),
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "asin": np.arcsin,
        "acos": np.arccos,
        "atan": np.arctan,
        "atan2": np.arctan2,
        "exp": np.exp,
        "log": np.log,
        "sqrt": np.sqrt,
        "abs": np.abs,
        # nan stays nan: what has no value has no side of 0.
        "step": lambda value: np.heaviside(value, 1.0),
    }
