"""The syntax tree of an equation: what it holds, its names, its text, and its linear form."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from mtu_cli.findings import InputError, error, finding, shorten, suggestion

PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 4}
"""How tightly binary operators bind; unary minus lies between * and **."""


@dataclass(frozen=True, slots=True)
class Number:
    """A literal, or the constant pi."""

    value: float
    column: int


@dataclass(frozen=True, slots=True)
class Name:
    """A position, a constant, a covariate or a component."""

    name: str
    column: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function of its arguments, or an operator of its operands, whose `column` it has.

    A binary operator goes by its sign, unary minus as ``neg``.
    """

    function: str
    arguments: tuple[Node, ...]
    column: int


Node = Number | Name | Call


def walk(node: Node) -> Iterator[Node]:
    """Every node of the tree, parents first, from left to right."""
    waiting = [node]
    while waiting:
        item = waiting.pop()
        yield item
        if isinstance(item, Call):
            waiting.extend(reversed(item.arguments))


def names(node: Node) -> dict[str, int]:
    """The names in the tree with the column of their first use."""
    result: dict[str, int] = {}
    for item in walk(node):
        if isinstance(item, Name):
            result[item.name] = min(item.column, result.get(item.name, item.column))
    return result


def check_known(node: Node, symbols: Collection[str], what: str = "name") -> None:
    """That an equation has no names but these `symbols`.

    Raises InputError with all others, each with its column and the closest symbol.
    """
    faults = [
        finding("unknown-name", what=what, value=name, column=column, **suggestion(name, symbols))
        for name, column in names(node).items()
        if name not in symbols
    ]
    if faults:
        raise InputError(faults)


def terms(node: Node) -> Iterator[Node]:
    """The terms of a sum, without their signs."""
    match node:
        case Call("+" | "-" | "neg", operands):
            for operand in operands:
                yield from terms(operand)
        case _:
            yield node


def first_column(node: Node) -> int:
    """The column at which a term begins."""
    return min(item.column for item in walk(node))


def literal_value(node: Node) -> float | None:
    """The value of a number, which a template that was filled in may have negated."""
    match node:
        case Number(value):
            return value
        case Call("neg", (operand,)):
            inner = literal_value(operand)
            return None if inner is None else -inner
    return None


def has_literal(node: Node) -> bool:
    """Whether a term holds a number that is no exponent."""
    match node:
        case Call("**", (base, _)):
            return has_literal(base)
        case Call(_, arguments):
            return any(map(has_literal, arguments))
    return isinstance(node, Number)


def short_text(node: Node) -> str:
    """A term as a message shows it."""
    return shorten(to_text(node))


def to_text(node: Node, outer: int = 0) -> str:
    """The equation as text that parses back to the same tree; in parentheses where it binds less
    tightly than `outer`.
    """
    match node:
        case Number(value):
            text = repr(value).removesuffix(".0")
            # As the base of ** only: -2**x would be -(2**x).
            return _wrap(text, text.startswith("-") and outer > 4)
        case Name(name):
            return name
        case Call("neg", (operand,)):
            return _wrap(f"-{to_text(operand, 3)}", outer > 2)
        case Call(sign, (left, right)) if sign in PRECEDENCE:
            precedence = PRECEDENCE[sign]
            # The left side of ** and the right side of the others need parentheses at
            # equal precedence: ** groups to the right, the others to the left.
            left_text = to_text(left, precedence + (sign == "**"))
            right_text = to_text(right, precedence if sign == "**" else precedence + 1)
            if sign != "**" and not isinstance(right, Number):
                # a - -b*c would parse back, but nobody would read it.
                right_text = _wrap(right_text, right_text.startswith("-"))
            space = " " if sign in "+-" else ""
            return _wrap(f"{left_text}{space}{sign}{space}{right_text}", precedence < outer)
        case Call(function, arguments):
            return f"{function}({', '.join(to_text(item) for item in arguments)})"


def _wrap(text: str, needed: bool) -> str:
    return f"({text})" if needed else text


def filled_tree(node: Node, filling: Mapping[str, float | str]) -> Node:
    """The tree with its names as `filling` says; sums with a negative number become differences."""
    match node:
        case Name(name, column):
            new = filling.get(name, name)
            return Name(new, column) if isinstance(new, str) else Number(new, column)
        case Call("+" | "-" as sign, (left, right), column):
            new_left, new_right = filled_tree(left, filling), filled_tree(right, filling)
            if isinstance(new_right, Number):
                if new_right.value == 0.0:
                    return new_left
                if new_right.value < 0.0:
                    # x - -5 and x + 5 are the same number, bit by bit.
                    opposite = Number(-new_right.value, new_right.column)
                    return Call("+" if sign == "-" else "-", (new_left, opposite), column)
            return Call(sign, (new_left, new_right), column)
        case Call(function, arguments, column):
            return Call(function, tuple(filled_tree(item, filling) for item in arguments), column)
    return node


_TWO_PI = re.compile(r"(^|\(|[+-] )6\.283185307179586\*")


def filled_text(tree: Node, filling: Mapping[str, float | str]) -> str:
    """The equation with its names as `filling` says: another name, or a number in full."""
    # The parser folds 2*pi to one number: written so again, it reads as what it is.
    return _TWO_PI.sub(r"\g<1>2*pi*", to_text(filled_tree(tree, filling)))


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


def _split(node: Node, linear: Collection[str]) -> dict[str, Node]:
    """The coefficient of every linear name, and of "": what holds none."""
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
