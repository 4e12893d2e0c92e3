"""Equations as linear forms: one coefficient expression a component, and a remainder."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from mtu_cli.findings import InputError, error
from mtu_cli.language.tree import Call, Name, Node, Number, names

Parts = dict[str, Node]
"""The coefficient of every linear name, and of "": what holds none."""


@dataclass(frozen=True, slots=True)
class LinearForm:
    """``sum over c of coefficients[c]*c + remainder``; neither part holds a linear name."""

    coefficients: dict[str, Node]
    remainder: Node | None


def linear_form(node: Node, linear: Collection[str]) -> LinearForm:
    """Writes an equation as a linear form in the names `linear`.

    Raises InputError with the column at which linearity is lost: a product of two of
    them, a division by one, a power or a function of one.
    """
    parts = _split(node, linear)
    remainder = parts.pop("", None)
    return LinearForm(parts, remainder)


def _split(node: Node, linear: Collection[str]) -> Parts:
    if not any(name in linear for name in names(node)):
        return {"": node}
    match node:
        case Name(name, column):
            return {name: Number(1.0, column)}
        case Call("neg", (operand,), column):
            return {name: _negative(part, column) for name, part in _split(operand, linear).items()}
        case Call("+" | "-" as sign, (left, right), column):
            result = _split(left, linear)
            for key, part in _split(right, linear).items():
                signed = _negative(part, column) if sign == "-" else part
                term = result.get(key)
                result[key] = signed if term is None else Call("+", (term, signed), column)
            return result
        case Call("*", (left, right), column):
            of_left, of_right = _split(left, linear), _split(right, linear)
            if set(of_left) == {""}:
                return {name: _times(left, part, column) for name, part in of_right.items()}
            if set(of_right) == {""}:
                return {name: _times(part, right, column) for name, part in of_left.items()}
            pair = [next(name for name in side if name) for side in (of_left, of_right)]
            raise _not_linear(pair, "their product", column)
        case Call("/", (left, right), column):
            if not any(name in linear for name in names(right)):
                parts = _split(left, linear).items()
                return {name: Call("/", (part, right), column) for name, part in parts}
            offender, how = right, "in a denominator"
        case Call(function):
            offender, how = node, "in a power" if function == "**" else f"inside {function}()"
    name, column = next((name, at) for name, at in names(offender).items() if name in linear)
    raise _not_linear((name,), how, column)


def _negative(node: Node, column: int) -> Node:
    if isinstance(node, Number):
        return Number(-node.value, node.column)
    return Call("neg", (node,), column)


def _times(left: Node, right: Node, column: int) -> Node:
    factors = [item for item in (left, right) if item != Number(1.0, item.column)]
    return Call("*", (left, right), column) if len(factors) == 2 else (factors or [right])[0]


def _not_linear(at_fault: Collection[str], how: str, column: int) -> InputError:
    what = " and ".join(map(repr, at_fault))
    expected = "an equation that is linear in components and parameters"
    return error("not-linear", names=what, how=how, column=column, expected=expected)
