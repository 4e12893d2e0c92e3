"""Dimensions of equations: a length must not be added to an angle.

Only lengths count: a dimension is the exponent of length, 0 for angles and plain numbers.
A name whose dimension is not known (a covariate, a constant) may stand for anything; a
literal is a pure number in a product and takes the other side's dimension in a sum.
"""

from __future__ import annotations

from collections.abc import Mapping

from mtu_cli.language.errors import EquationError
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number
from mtu_cli.units import dimension_name

UNKNOWN = None


def check_dimension(node: Node, wanted: int, dimensions: Mapping[str, int | None]) -> None:
    """Raises EquationError at the first term whose dimension is not `wanted`.

    `dimensions` gives the exponent of length of each name; None, or no entry, is unknown.
    """
    for term in _terms(node):
        found = _dimension(term, dimensions)
        if found is not UNKNOWN and found != wanted:
            hint = "multiply it by its lever arm (a position or a named constant)"
            raise EquationError(
                f"this term is {dimension_name(found)}, its equation is {dimension_name(wanted)}",
                _first_column(term),
                hint if found < wanted else f"a term that is {dimension_name(wanted)}",
            )


def _terms(node: Node) -> list[Node]:
    match node:
        case Binary("+" | "-", left, right):
            return [*_terms(left), *_terms(right)]
        case Negative(operand):
            return _terms(operand)
    return [node]


def _first_column(node: Node) -> int:
    match node:
        case Binary(_, left, _, column):
            return min(column, _first_column(left))
    return node.column


def _dimension(node: Node, known: Mapping[str, int | None]) -> int | None:
    match node:
        case Number():
            return UNKNOWN
        case Name(name):
            return known.get(name)
        case Negative(operand):
            return _dimension(operand, known)
        case Call(function, arguments):
            return _call_dimension(function, [_dimension(item, known) for item in arguments])
        case Binary("+" | "-", left, right, column):
            return _sum_dimension(_dimension(left, known), _dimension(right, known), column)
        case Binary("**", base, Number(exponent)):
            own = _dimension(base, known)
            scaled = None if own is None else own * exponent
            return int(scaled) if scaled is not None and scaled == int(scaled) else UNKNOWN
        case Binary("*" | "/" as operator, left, right):
            return _product_dimension(left, right, operator, known)
    return UNKNOWN


def _product_dimension(
    left: Node, right: Node, operator: str, known: Mapping[str, int | None]
) -> int | None:
    # A literal factor is a pure number: 127*ey_x stays an angle, and is told so.
    first = 0 if isinstance(left, Number) else _dimension(left, known)
    second = 0 if isinstance(right, Number) else _dimension(right, known)
    if first is UNKNOWN or second is UNKNOWN:
        return UNKNOWN
    return first + second if operator == "*" else first - second


def _sum_dimension(left: int | None, right: int | None, column: int) -> int | None:
    if left is UNKNOWN:
        return right
    if right is UNKNOWN or left == right:
        return left
    raise EquationError(
        f"{dimension_name(left)} and {dimension_name(right)} are added",
        column,
        "terms of one dimension",
    )


def _call_dimension(function: str, arguments: list[int | None]) -> int | None:
    if function == "abs":
        return arguments[0]
    if function == "sqrt":
        own = arguments[0]
        return own // 2 if own is not None and own % 2 == 0 else UNKNOWN
    return 0
