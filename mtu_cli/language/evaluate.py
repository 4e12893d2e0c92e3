"""The value of an equation over arrays, and of what holds constants alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from mtu_cli.findings import error
from mtu_cli.language.functions import BUDGET_FUNCTIONS, OPERATORS, apply_scalar
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number, shown

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
        value: Value = _value(node, values, _arrays())
    return value


def _value(node: Node, values: Mapping[str, Value], functions: Mapping[str, Any]) -> Any:
    match node:
        case Number(value):
            return value
        case Name(name, column):
            if name not in values:
                raise error("name-without-value", name=name, column=column)
            return values[name]
        case Negative(operand):
            return -_value(operand, values, functions)
        case Binary(operator, left, right):
            return functions[operator](
                _value(left, values, functions), _value(right, values, functions)
            )
        case Call(function, arguments):
            return functions[function](*(_value(item, values, functions) for item in arguments))


@cache
def _arrays() -> Mapping[str, Callable[..., Any]]:
    import numpy as np

    found = {name: getattr(np, own) for name, (_, own) in OPERATORS.items()}
    # numpy raises no negative integer to a power.
    found["**"] = lambda base, exponent: np.power(np.asarray(base, float), exponent)
    for name, item in BUDGET_FUNCTIONS.items():
        found[name] = getattr(np, item.array)
        if item.extra:
            found[name] = lambda *given, item=item: getattr(np, item.array)(*given, *item.extra)
    return found


def check_finite(node: Node, constants: Mapping[str, float]) -> float | None:
    """The value of what holds numbers and `constants` alone, None of what holds more.

    Raises InputError at the first operation on such values that has no finite real value, as
    `parse` does where they are numbers: ``1/(c - d)`` where c is d.
    """
    match node:
        case Number(value):
            return value
        case Name(name):
            return constants.get(name)
        case Negative(operand):
            inner = check_finite(operand, constants)
            return None if inner is None else -inner
        case Binary(name, left, right, column):
            operands: tuple[Node, ...] = (left, right)
        case Call(name, operands, column):
            pass
    found = [check_finite(item, constants) for item in operands]
    known = tuple(value for value in found if value is not None)
    if len(known) < len(found):
        return None
    result = apply_scalar(name, known)
    if result is None:
        raise error("no-finite-value", operation=name, column=column, value=shown(node))
    return result
