"""The syntax tree of an equation: what it holds, its names, its text."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import Literal

from mtu_cli.findings import InputError, finding, shorten, suggestion

Operator = Literal["+", "-", "*", "/", "**"]
PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 4}
"""How tightly operators bind; unary minus lies between * and **."""


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
class Negative:
    """Unary minus."""

    operand: Node
    column: int


@dataclass(frozen=True, slots=True)
class Binary:
    """``left operator right``; `column` is the operator's."""

    operator: Operator
    left: Node
    right: Node
    column: int


@dataclass(frozen=True, slots=True)
class Call:
    """``function(arguments)``."""

    function: str
    arguments: tuple[Node, ...]
    column: int


Node = Number | Name | Negative | Binary | Call


def children(node: Node) -> tuple[Node, ...]:
    """The operands of a node, from left to right."""
    match node:
        case Negative(operand):
            return (operand,)
        case Binary(_, left, right):
            return (left, right)
        case Call(_, arguments):
            return arguments
    return ()


def walk(node: Node) -> Iterator[Node]:
    """Every node of the tree, parents first, from left to right."""
    waiting = [node]
    while waiting:
        item = waiting.pop()
        yield item
        waiting.extend(reversed(children(item)))


def rewritten(node: Node, change: Callable[[Node], Node]) -> Node:
    """The tree with every node that `change` returns another for replaced, from the top down."""
    changed = change(node)
    if changed is not node:
        return changed
    match node:
        case Negative(operand):
            return replace(node, operand=rewritten(operand, change))
        case Binary(_, left, right):
            return replace(node, left=rewritten(left, change), right=rewritten(right, change))
        case Call(_, arguments):
            return replace(node, arguments=tuple(rewritten(item, change) for item in arguments))
    return node


def names(node: Node) -> dict[str, int]:
    """The names in the tree with the column of their first use."""
    found: dict[str, int] = {}
    for item in walk(node):
        if isinstance(item, Name):
            found[item.name] = min(item.column, found.get(item.name, item.column))
    return found


def check_known(node: Node, known: Collection[str], what: str = "name") -> None:
    """That an equation has no name but those `known`.

    Raises InputError with all others, each with its column and the closest known name.
    """
    unknown = [(name, column) for name, column in names(node).items() if name not in known]
    if unknown:
        raise InputError(
            finding("unknown-name", what=what, value=name, column=column, **suggestion(name, known))
            for name, column in unknown
        )


def terms(node: Node) -> Iterator[Node]:
    """The terms of a sum."""
    return (term for _, term in signed_terms(node))


def signed_terms(node: Node, sign: int = 1) -> Iterator[tuple[int, Node]]:
    """The terms of a sum, each with the sign that it is counted with."""
    match node:
        case Binary("+" | "-" as operator, left, right):
            yield from signed_terms(left, sign)
            yield from signed_terms(right, sign if operator == "+" else -sign)
        case Negative(operand):
            yield from signed_terms(operand, -sign)
        case _:
            yield sign, node


def first_column(node: Node) -> int:
    """The column at which a term begins."""
    match node:
        case Binary(_, left, _, column):
            return min(column, first_column(left))
    return node.column


def literal_value(node: Node) -> float | None:
    """The value of a number, which a template that was filled in may have negated."""
    match node:
        case Number(value):
            return value
        case Negative(operand):
            inner = literal_value(operand)
            return None if inner is None else -inner
    return None


def shown(node: Node) -> str:
    """A term as a message shows it."""
    return shorten(to_text(node))


def to_text(node: Node) -> str:
    """The equation as text that parses back to the same tree."""
    return _text(node, 0)


def _text(node: Node, outer: int) -> str:
    match node:
        case Number(value):
            text = repr(value)
            text = text[:-2] if text.endswith(".0") else text
            # As the base of ** only: -2**x would be -(2**x).
            return _wrap(text, text.startswith("-") and outer > 4)
        case Name(name):
            return name
        case Call(function, arguments):
            return f"{function}({', '.join(_text(item, 0) for item in arguments)})"
        case Negative(operand):
            return _wrap(f"-{_text(operand, 3)}", outer > 2)
        case Binary(operator, left, right):
            own = PRECEDENCE[operator]
            # The left side of ** and the right side of the others need parentheses at
            # equal precedence: ** groups to the right, the others to the left.
            left_text = _text(left, own + (operator == "**"))
            right_text = _text(right, own if operator == "**" else own + 1)
            if operator != "**" and not isinstance(right, Number):
                # a - -b*c would parse back, but nobody would read it.
                right_text = _wrap(right_text, right_text.startswith("-"))
            joint = f"{left_text}{operator}{right_text}"
            if operator in "+-":
                joint = f"{left_text} {operator} {right_text}"
            return _wrap(joint, own < outer)


def _wrap(text: str, needed: bool) -> str:
    return f"({text})" if needed else text
