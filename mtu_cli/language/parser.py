"""Text to syntax tree: a Pratt parser with bounded length, depth and size."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

from mtu_cli.findings import InputError, error, suggestion
from mtu_cli.language.functions import MACHINE_FUNCTIONS, Function, apply_scalar
from mtu_cli.language.tree import (
    PRECEDENCE,
    Binary,
    Call,
    Name,
    Negative,
    Node,
    Number,
    Operator,
)

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
        raise _too_large(len(text), "characters", MAX_CHARACTERS, MAX_CHARACTERS)
    return _Parser(_tokens(text, _token(name)), functions, len(text) + 1).whole()


@cache
def _token(name: str) -> re.Pattern[str]:
    return re.compile(
        r"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
        rf"|(?P<name>{name})"
        r"|(?P<operator>\*\*|[-+*/(),]))"
    )


def _too_large(number: int, unit: str, most: int, column: int) -> InputError:
    return error(
        "equation-too-large", number=number, unit=unit, column=column, expected=f"at most {most}"
    )


def _tokens(text: str, pattern: re.Pattern[str]) -> list[_Token]:
    tokens: list[_Token] = []
    position = 0
    end = len(text.rstrip())
    while position < end:
        match = pattern.match(text, position)
        if match is None:
            start = position + len(text[position:]) - len(text[position:].lstrip())
            expected = "a number, a name, + - * / ** or parentheses"
            if text[start] == "^":
                expected = "** for a power"
            raise _unexpected(_Token("", text[start], start + 1), expected)
        kind = match.lastgroup or ""
        tokens.append(_Token(kind, match.group(kind), match.start(kind) + 1))
        position = match.end()
    operators = [token for token in tokens if token.text in PRECEDENCE]
    if len(operators) > MAX_OPERATORS:
        column = operators[MAX_OPERATORS].column
        raise _too_large(len(operators), "operators", MAX_OPERATORS, column)
    return tokens


def _unexpected(token: _Token, expected: str) -> InputError:
    text = "end of the equation" if token.kind == "end" else repr(token.text)
    return error("equation-syntax", token=text, column=token.column, expected=expected)


class _Parser:
    def __init__(self, tokens: list[_Token], functions: Mapping[str, Function], end: int) -> None:
        self.tokens = tokens
        self.functions = functions
        self.end = end
        self.position = 0
        self.depth = 0

    def peek(self) -> _Token:
        if self.position < len(self.tokens):
            return self.tokens[self.position]
        return _Token("end", "", self.end)

    def take(self) -> _Token:
        token = self.peek()
        self.position += 1
        return token

    def whole(self) -> Node:
        if not self.tokens:
            raise _unexpected(_Token("end", "", 1), "an expression")
        tree = self.expression(0)
        left = self.peek()
        if left.kind != "end":
            expected = "an operator or the end of the equation"
            if left.kind != "operator" or left.text == "(":
                expected = "an operator, such as * between factors, or the end of the equation"
            raise _unexpected(left, expected)
        return tree

    def expression(self, minimum: int) -> Node:
        """An expression whose operators bind tighter than `minimum`."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _too_large(self.depth, "levels", MAX_DEPTH, self.peek().column)
        left = self.prefix()
        while True:
            token = self.peek()
            power = PRECEDENCE.get(token.text, 0)
            if token.kind != "operator" or power <= minimum:
                break
            self.take()
            # ** groups to the right: its right side may hold ** again.
            right = self.expression(power - 1 if token.text == "**" else power)
            left = _finite(Binary(_operator(token.text), left, right, token.column))
        self.depth -= 1
        return left

    def prefix(self) -> Node:
        token = self.take()
        if token.kind == "number":
            return _number(token)
        if token.kind == "name":
            return self.name(token)
        if token.text == "-":
            # Weaker than ** and stronger than *: -x**2 is -(x**2).
            operand = self.expression(3)
            if isinstance(operand, Number):
                return Number(-operand.value, token.column)
            return Negative(operand, token.column)
        if token.text == "+":
            return self.expression(3)
        if token.text == "(":
            inner = self.expression(0)
            self.expect(")", token)
            return inner
        raise _unexpected(token, "a number, a name or '('")

    def name(self, token: _Token) -> Node:
        if self.peek().text == "(":
            return self.call(token)
        if token.text == "pi":
            return Number(math.pi, token.column)
        if token.text in self.functions:
            raise _arguments(token, 0, f"{token.text}(...)")
        return Name(token.text, token.column)

    def call(self, token: _Token) -> Node:
        if token.text not in self.functions:
            near = suggestion(token.text, self.functions)
            raise error(
                "unknown-name", what="function", value=token.text, column=token.column, **near
            )
        opening = self.take()
        arguments = [self.expression(0)]
        while self.peek().text == ",":
            self.take()
            arguments.append(self.expression(0))
        self.expect(")", opening)
        wanted = self.functions[token.text].arity
        if len(arguments) != wanted:
            raise _arguments(token, len(arguments), str(wanted))
        return _finite(Call(token.text, tuple(arguments), token.column))

    def expect(self, text: str, opening: _Token) -> None:
        token = self.take()
        if token.text != text:
            raise _unexpected(token, f"{text!r} for the '(' at column {opening.column}")


def _arguments(token: _Token, number: int, expected: str) -> InputError:
    return error(
        "function-arguments",
        function=token.text,
        number=number,
        column=token.column,
        expected=expected,
    )


def _operator(text: str) -> Operator:
    match text:
        case "+" | "-" | "*" | "/" | "**":
            return text
    raise ValueError(text)


def _number(token: _Token) -> Number:
    value = float(token.text)
    if not math.isfinite(value):
        raise error("not-finite", value=token.text, column=token.column)
    return Number(value, token.column)


def _finite(node: Node) -> Node:
    """Folds an operation on literals, so that one without a finite value is refused at once.

    Folding as the tree is built keeps the check linear in its size.
    """
    match node:
        case Binary(operator, Number(left), Number(right), column):
            operands: tuple[float, ...] = (left, right)
            name: str = operator
        case Call(function, arguments, column) if all(isinstance(a, Number) for a in arguments):
            operands = tuple(a.value for a in arguments if isinstance(a, Number))
            name = function
        case _:
            return node
    value = apply_scalar(name, operands)
    if value is None:
        raise error("no-finite-value", operation=name, column=column)
    return Number(value, column)
