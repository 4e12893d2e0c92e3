"""Operations on constants that have no finite value: ``1/(c - d)`` where c is d."""

from __future__ import annotations

from collections.abc import Mapping

from mtu_cli.language.dimensions import shown
from mtu_cli.language.errors import EquationError
from mtu_cli.language.scalar import apply_scalar
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number


def check_finite(node: Node, constants: Mapping[str, float]) -> float | None:
    """The value of what holds numbers and `constants` alone, None of what holds more.

    Raises EquationError at the first operation on such values that has no finite real value, as
    `parse` does where they are numbers.
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
        what = f"{name!r} of these constants has no finite value"
        raise EquationError(what, column, value=shown(node))
    return result
