"""Text to syntax tree: a Pratt parser with bounded length, depth and size."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from mtu_cli.findings import InputError, error, suggestion
from mtu_cli.language.functions import MACHINE_FUNCTIONS, Function, folded
from mtu_cli.language.tree import PRECEDENCE, Call, Name, Node, Number

MAX_CHARACTERS = 20_000
MAX_DEPTH = 60
MAX_OPERATORS = 300
"""The tree of a long sum is as deep as its terms are many, and is walked recursively."""

NAME = r"[A-Za-z_][A-Za-z_0-9]*"
BRACED = r"(?:[A-Za-z_]|\{[A-Za-z_0-9]++\})(?:[A-Za-z_0-9]|\{[A-Za-z_0-9]++\})*+"
"""Names of templates, of which parts may stand in braces: ``dir_{a}``."""
DOTTED = NAME + r"(?:\.[A-Za-z_][A-Za-z_0-9]*)?"
"""Names of coordinates of places: ``H1.x``."""


class _Token(NamedTuple):
    kind: str
    text: str
    column: int


def parse(
    text: str, functions: Mapping[str, Function] = MACHINE_FUNCTIONS, name: str = NAME
) -> Node:
    """The syntax tree of an equation.

    `functions` are the known ones, `name` is the pattern of names: `NAME`, `BRACED` or `DOTTED`.
    Constant parts such as ``2*pi/360`` are folded to one number, which must be finite.

    Raises InputError with the column for anything that is not an equation, is longer
    than 20 000 characters, has more than 300 operators or is nested deeper than 60 levels.
    """
    if len(text) > MAX_CHARACTERS:
        raise _too_large("characters", MAX_CHARACTERS, MAX_CHARACTERS)
    return _Parser(_tokens(text, name), functions).whole()


def _too_large(what: str, most: int, column: int) -> InputError:
    return error("too-large", most=most, what=f"{what} of an equation", column=column)


def _tokens(text: str, name: str) -> list[_Token]:
    """The words of an equation, and last its end."""
    pattern = re.compile(
        r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
        rf"|(?P<name>{name})|(?P<operator>\*\*|[-+*/(),])|(?P<other>\S)"
    )
    matches = pattern.finditer(text)
    tokens = [_Token(str(match.lastgroup), match[0], match.start() + 1) for match in matches]
    for token in tokens:
        if token.kind == "other":
            raise _unexpected(token, "a number, a name, + - * / ** or parentheses")
    operators = [token for token in tokens if token.text in PRECEDENCE]
    if len(operators) > MAX_OPERATORS:
        raise _too_large("operators", MAX_OPERATORS, operators[MAX_OPERATORS].column)
    return [*tokens, _Token("end", "", len(text) + 1 if tokens else 1)]


def _unexpected(token: _Token, expected: str) -> InputError:
    text = "end of the equation" if token.kind == "end" else repr(token.text)
    return error("equation-syntax", token=text, column=token.column, expected=expected)


class _Parser:
    def __init__(self, tokens: list[_Token], functions: Mapping[str, Function]) -> None:
        self.tokens = tokens
        self.functions = functions
        self.position = self.depth = 0

    def peek(self) -> _Token:
        return self.tokens[self.position]

    def take(self) -> _Token:
        self.position += 1
        return self.tokens[self.position - 1]

    def whole(self) -> Node:
        tree = self.expression(0)
        rest = self.peek()
        if rest.kind == "end":
            return tree
        expected = "an operator or the end of the equation"
        if rest.kind != "operator" or rest.text == "(":
            expected = "an operator, such as * between factors, or the end of the equation"
        raise _unexpected(rest, expected)

    def expression(self, minimum: int) -> Node:
        """An expression whose operators bind tighter than `minimum`."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _too_large("levels", MAX_DEPTH, self.peek().column)
        left = self.prefix()
        while (power := PRECEDENCE.get(self.peek().text, 0)) > minimum:
            sign = self.take()
            # ** groups to the right: its right side may hold ** again.
            right = self.expression(power - 1 if sign.text == "**" else power)
            left = folded(Call(sign.text, (left, right), sign.column))
        self.depth -= 1
        return left

    def prefix(self) -> Node:
        token = self.take()
        if token.kind == "number":
            if not math.isfinite(value := float(token.text)):
                kind = "a finite number"
                raise error("wrong-type", kind=kind, value=token.text, column=token.column)
            return Number(value, token.column)
        if token.kind == "name":
            return self.name(token)
        if token.text in ("-", "+"):
            # Weaker than ** and stronger than *: -x**2 is -(x**2).
            operand = self.expression(3)
            return operand if token.text == "+" else folded(Call("neg", (operand,), token.column))
        if token.text == "(":
            inner = self.expression(0)
            self.close(token)
            return inner
        raise _unexpected(token, "a number, a name or '('")

    def name(self, token: _Token) -> Node:
        """A name, pi or a function with its arguments."""
        name, column = token.text, token.column
        opening = self.peek()
        if opening.text != "(":
            if name == "pi":
                return Number(math.pi, column)
            if name in self.functions:
                raise _arguments(token, 0, f"{name}(...)")
            return Name(name, column)
        if name not in self.functions:
            near = suggestion(name, self.functions)
            raise error("unknown-name", what="function", value=name, column=column, **near)
        arguments: list[Node] = []
        while not arguments or self.peek().text == ",":
            self.take()
            arguments.append(self.expression(0))
        self.close(opening)
        arity = self.functions[name].arity
        if len(arguments) != arity:
            raise _arguments(token, len(arguments), str(arity))
        return folded(Call(name, tuple(arguments), column))

    def close(self, opening: _Token) -> None:
        token = self.take()
        if token.text != ")":
            raise _unexpected(token, f"')' for the '(' at column {opening.column}")


def _arguments(token: _Token, number: int, expected: str) -> InputError:
    result = f"{token.text} has {number} arguments"
    return error("wrong-count", found=result, column=token.column, expected=expected)
