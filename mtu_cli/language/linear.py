"""Equations as linear forms: one coefficient expression a component, and a remainder."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from mtu_cli.findings import InputError, error
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number, names


@dataclass(frozen=True, slots=True)
class LinearForm:
    """``sum over c of coefficients[c]*c + remainder``; neither part holds a linear name."""

    coefficients: dict[str, Node]
    remainder: Node | None


COMPONENT, PARAMETER = "component", "parameter"


def linear_form(
    node: Node, linear_names: Collection[str], parameters: Collection[str] = ()
) -> LinearForm:
    """Writes an equation as a linear form in `linear_names`; those of them in `parameters` are an
    effect's and are called so.

    Raises InputError with the column at which linearity is lost: a product of two
    components, a division by one, a power or a function of one.
    """
    linear = {name: PARAMETER if name in parameters else COMPONENT for name in linear_names}
    coefficients, remainder = _split(node, linear)
    return LinearForm(coefficients, remainder)


Parts = tuple[dict[str, Node], Node | None]


def _split(node: Node, linear: Mapping[str, str]) -> Parts:
    if not any(name in linear for name in names(node)):
        return {}, node
    match node:
        case Name(name, column):
            return {name: Number(1.0, column)}, None
        case Negative(operand, column):
            return _scaled(_split(operand, linear), lambda part: _negative(part, column))
        case Binary("+" | "-" as operator, left, right, column):
            return _sum(_split(left, linear), _split(right, linear), operator == "-", column)
        case Binary("*", left, right, column):
            return _product(left, right, column, linear)
        case Binary("/", left, right, column):
            _refuse(right, linear, "in a denominator")
            return _scaled(_split(left, linear), lambda part: Binary("/", part, right, column))
        case Binary("**", _, _, _):
            _refuse(node, linear, "in a power")
        case Call(function, _, _):
            _refuse(node, linear, f"inside {function}()")
    raise AssertionError(node)


def _product(left: Node, right: Node, column: int, linear: Mapping[str, str]) -> Parts:
    in_left = [name for name in names(left) if name in linear]
    in_right = [name for name in names(right) if name in linear]
    if in_left and in_right:
        # What stands inside a function is reported as such.
        _split(left, linear)
        _split(right, linear)
        raise _not_linear((in_left[0], in_right[0]), linear, "their product", column)
    if in_left:
        return _scaled(_split(left, linear), lambda part: _times(part, right, column))
    return _scaled(_split(right, linear), lambda part: _times(left, part, column))


def _scaled(parts: Parts, scale: Callable[[Node], Node]) -> Parts:
    coefficients, remainder = parts
    scaled = {name: scale(part) for name, part in coefficients.items()}
    return scaled, None if remainder is None else scale(remainder)


def _sum(left: Parts, right: Parts, minus: bool, column: int) -> Parts:
    coefficients = dict(left[0])
    for name, part in right[0].items():
        signed = _negative(part, column) if minus else part
        own = coefficients.get(name)
        coefficients[name] = signed if own is None else Binary("+", own, signed, column)
    remainder = left[1]
    if right[1] is not None:
        signed = _negative(right[1], column) if minus else right[1]
        remainder = signed if remainder is None else Binary("+", remainder, signed, column)
    return coefficients, remainder


def _negative(node: Node, column: int) -> Node:
    if isinstance(node, Number):
        return Number(-node.value, node.column)
    return Negative(node, column)


def _times(left: Node, right: Node, column: int) -> Node:
    if left == Number(1.0, left.column):
        return right
    if right == Number(1.0, right.column):
        return left
    return Binary("*", left, right, column)


def _refuse(node: Node, linear: Mapping[str, str], how: str) -> None:
    inside = {name: column for name, column in names(node).items() if name in linear}
    if inside:
        name = min(inside, key=lambda key: inside[key])
        raise _not_linear((name,), linear, how, inside[name])


def _not_linear(
    told: Collection[str], linear: Mapping[str, str], how: str, column: int
) -> InputError:
    what = " and ".join(f"the {linear[name]} {name!r}" for name in told)
    kinds = " and ".join(f"{kind}s" for kind in dict.fromkeys(linear[name] for name in told))
    expected = f"an equation that is linear in the {kinds}"
    return error("not-linear", names=what, how=how, column=column, expected=expected)
