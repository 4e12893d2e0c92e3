"""Text to syntax tree: a Pratt parser with bounded length, depth and size."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from mtu_cli.errors import did_you_mean
from mtu_cli.language.errors import EquationError
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.scalar import apply_scalar
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

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<operator>\*\*|[-+*/(),]))"
)


class _Token(NamedTuple):
    kind: str
    text: str
    column: int


def parse(text: str, functions: Mapping[str, int] = MACHINE_FUNCTIONS) -> Node:
    """The syntax tree of an equation.

    `functions` maps each known function to its number of arguments. Constant parts such as
    ``2*pi/360`` are folded to one number, which must be finite.

    Raises EquationError with the column for anything that is not an equation, is longer
    than 20 000 characters, has more than 300 operators or is nested deeper than 60 levels.
    """
    if len(text) > MAX_CHARACTERS:
        raise EquationError(
            f"the equation has {len(text)} characters",
            MAX_CHARACTERS,
            f"at most {MAX_CHARACTERS}",
        )
    return _Parser(_tokens(text), functions, len(text) + 1).whole()


def _tokens(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    position = 0
    end = len(text.rstrip())
    while position < end:
        match = _TOKEN.match(text, position)
        if match is None:
            start = position + len(text[position:]) - len(text[position:].lstrip())
            expected = "a number, a name, + - * / ** or parentheses"
            if text[start] == "^":
                expected = "** for a power"
            raise EquationError(f"unexpected character {text[start]!r}", start + 1, expected)
        kind = match.lastgroup or ""
        tokens.append(_Token(kind, match.group(kind), match.start(kind) + 1))
        position = match.end()
    operators = [token for token in tokens if token.text in PRECEDENCE]
    if len(operators) > MAX_OPERATORS:
        raise EquationError(
            f"the equation has {len(operators)} operators",
            operators[MAX_OPERATORS].column,
            f"at most {MAX_OPERATORS}",
        )
    return tokens


class _Parser:
    def __init__(self, tokens: list[_Token], functions: Mapping[str, int], end: int) -> None:
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
            raise EquationError("the equation is empty", 1, "an expression")
        tree = self.expression(0)
        left = self.peek()
        if left.kind != "end":
            expected = "an operator or the end of the equation"
            if left.kind != "operator" or left.text == "(":
                expected = "an operator, such as * between factors, or the end of the equation"
            raise EquationError(f"unexpected {left.text!r}", left.column, expected)
        return tree

    def expression(self, minimum: int) -> Node:
        """An expression whose operators bind tighter than `minimum`."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise EquationError(
                f"the equation is nested deeper than {MAX_DEPTH} levels", self.peek().column
            )
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
        what = (
            "the equation ends too early" if token.kind == "end" else f"unexpected {token.text!r}"
        )
        raise EquationError(what, token.column, "a number, a name or '('")

    def name(self, token: _Token) -> Node:
        if self.peek().text == "(":
            return self.call(token)
        if token.text == "pi":
            return Number(math.pi, token.column)
        if token.text in self.functions:
            raise EquationError(
                f"the function {token.text!r} needs parentheses", token.column, f"{token.text}(...)"
            )
        return Name(token.text, token.column)

    def call(self, token: _Token) -> Node:
        if token.text not in self.functions:
            raise EquationError(
                f"unknown function {token.text!r}",
                token.column,
                did_you_mean(token.text, self.functions),
            )
        opening = self.take()
        arguments = [self.expression(0)]
        while self.peek().text == ",":
            self.take()
            arguments.append(self.expression(0))
        self.expect(")", opening)
        wanted = self.functions[token.text]
        if len(arguments) != wanted:
            raise EquationError(
                f"{token.text} has {len(arguments)} arguments", token.column, f"{wanted}"
            )
        return _finite(Call(token.text, tuple(arguments), token.column))

    def expect(self, text: str, opening: _Token) -> None:
        token = self.take()
        if token.text != text:
            raise EquationError(
                f"the parenthesis opened at column {opening.column} is not closed",
                token.column,
                f"{text!r}",
            )


def _operator(text: str) -> Operator:
    match text:
        case "+" | "-" | "*" | "/" | "**":
            return text
    raise ValueError(text)


def _number(token: _Token) -> Number:
    value = float(token.text)
    if not math.isfinite(value):
        raise EquationError(f"the number {token.text} is not finite", token.column)
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
        raise EquationError(f"{name!r} of these numbers has no finite value", column)
    return Number(value, column)
