"""The value of an equation over arrays, and of what holds constants alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from mtu_cli.findings import error
from mtu_cli.language.functions import FUNCTIONS, apply_scalar
from mtu_cli.language.tree import Call, Name, Node, Number, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Value = float | NDArray[np.float64]


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
            return given(name, values, column)
        case Call(function, arguments):
            return _array(function)(*(_value(item, values) for item in arguments))


def given(name: str, values: Mapping[str, Any], column: int) -> Any:
    """The value of a name. Raises InputError where it has none."""
    if name not in values:
        raise error("missing-input", what=f"the value of '{name}'", column=column)
    return values[name]


@cache
def _array(name: str) -> Callable[..., Any]:
    import numpy as np

    if name == "step":  # numpy's keeps nan: what has no value has no side of 0
        return lambda u: np.heaviside(u, 1.0)
    if name == "**":  # numpy raises no negative integer to a power
        return lambda base, exponent: np.power(np.asarray(base, float), exponent)
    function: Callable[..., Any] = getattr(np, FUNCTIONS[name].array)
    return function


def folded(node: Call, written: Node | None = None) -> Node:
    """The number that an operation on numbers gives; any other as it is.

    Raises InputError where it has no finite real value; `written` is how a message shows it.
    """
    operands = tuple(item.value for item in node.arguments if isinstance(item, Number))
    if len(operands) < len(node.arguments):
        return node
    value = apply_scalar(node.function, operands)
    if value is None:
        what = f"'{node.function}' of these constants"
        text = None if written is None else shown(written)
        raise error("no-finite-value", what=what, where="", column=node.column, value=text)
    return Number(value, node.column)


def check_finite(node: Node, constants: Mapping[str, float]) -> Node:
    """The tree with its `constants` as numbers, operations on numbers alone folded to one.

    Raises InputError at the first of them that has no finite real value, as `parse` does where
    they are numbers: ``1/(c - d)`` where c is d.
    """
    match node:
        case Name(name, column) if name in constants:
            return Number(constants[name], column)
        case Call(function, arguments, column):
            known = tuple(check_finite(item, constants) for item in arguments)
            return folded(Call(function, known, column), node)
    return node
