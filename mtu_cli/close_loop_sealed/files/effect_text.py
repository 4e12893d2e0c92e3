"""Equations of effects as text: names and numbers in place of those in braces."""

from __future__ import annotations

import re
from collections.abc import Mapping

from mtu_cli.language import Node, to_text
from mtu_cli.language.tree import Binary, Call, Name, Negative, Number

_TWO_PI = re.compile(r"(^|\(|[+-] )6\.283185307179586\*")


def equation_text(tree: Node, filling: Mapping[str, float | str]) -> str:
    """The equation with its names as `filling` says: another name, or a number in full."""
    # The parser folds 2*pi to one number: written so again, it reads as what it is.
    return _TWO_PI.sub(r"\g<1>2*pi*", to_text(filled_tree(tree, filling)))


def with_number(texts: Mapping[str, str], name: str, value: float) -> dict[str, str]:
    """Equations in which `name` has become a number."""
    number = to_text(Number(value, 0))
    shown = f"({number})" if value < 0.0 else number
    return {key: re.sub(rf"\b{name}\b", shown, text) for key, text in texts.items()}


def filled_tree(node: Node, filling: Mapping[str, float | str]) -> Node:
    """The tree with its names as `filling` says; sums with a negative number are turned."""
    match node:
        case Name(name, column):
            new = filling.get(name, name)
            return Name(new, column) if isinstance(new, str) else Number(new, column)
        case Negative(operand, column):
            return Negative(filled_tree(operand, filling), column)
        case Call(function, arguments, column):
            return Call(function, tuple(filled_tree(item, filling) for item in arguments), column)
        case Binary(operator, left, right, column):
            new_left, new_right = filled_tree(left, filling), filled_tree(right, filling)
            if operator in "+-" and isinstance(new_right, Number):
                if new_right.value == 0.0:
                    return new_left
                if new_right.value < 0.0:
                    # x - -5 and x + 5 are the same number, bit by bit.
                    turned = Number(-new_right.value, new_right.column)
                    return Binary("+" if operator == "-" else "-", new_left, turned, column)
            return Binary(operator, new_left, new_right, column)
    return node
