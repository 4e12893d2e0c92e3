"""Dimensions of equations: a length must not be added to an angle.

A dimension is the exponent of one base quantity, such as that of length, 0 for angles and plain
numbers; whatever multiplies as units do can be such an exponent, the logarithm of a unit's size
for one. A name whose dimension is not known (a constant, say) may stand for anything. In a sum a
literal takes the other side's dimension. In a product it is a pure number where lengths are
counted; in the argument of a function, and where temperatures and times are counted, it may have
a unit that is not written: ``exp(-time_min/30)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from mtu_cli.language.errors import EquationError
from mtu_cli.language.tree import Binary, Call, Name, Negative, Node, Number, to_text, walk
from mtu_cli.units import DEGREE, MINUTE, dimension_name

UNKNOWN = None
Exponent = float | None
SAME = 1e-9
"""Exponents that differ by less are one."""
NUMBERS = ("sin", "cos", "tan", "exp", "log", "asin", "acos", "atan")
"""Functions of plain numbers and angles alone."""
LONGEST = 60
"""Characters of a term that a message shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """One base quantity: exponents of the `known` names, that of a `literal` factor, the words for
    an exponent, and the unit that a literal in an argument may have. Where exponents are `whole`,
    a broken one is unknown.
    """

    known: Mapping[str, Exponent]
    words: Callable[[float], str]
    unit: str
    literal: Callable[[float], Exponent] = lambda _: 0
    whole: bool = True

    def times(self, own: Exponent, power: float) -> Exponent:
        """The exponent of a power."""
        if own is UNKNOWN:
            return UNKNOWN
        found = own * power
        return UNKNOWN if self.whole and found != int(found) else found


def check_arguments(node: Node, scale: Scale) -> None:
    """Raises EquationError at the first argument of a function of plain numbers, or exponent of a
    power, that has a unit; a literal factor in it may take that away.
    """
    scale = replace(scale, literal=lambda _: UNKNOWN)
    for item in walk(node):
        match item:
            case Call("atan2", (left, right), column):
                _sum(exponent(left, scale), exponent(right, scale), column, scale, "are compared")
            case Call(function, (argument,)) if function in NUMBERS:
                _check_argument(argument, f"{function} of", scale)
            case Binary("**", _, power):
                _check_argument(power, "an exponent that is", scale)


def _check_argument(argument: Node, of: str, scale: Scale) -> None:
    found = exponent(argument, scale)
    if found is UNKNOWN or abs(found) < SAME:
        return
    raise EquationError(
        f"{of} {scale.words(found)}",
        first_column(argument),
        f"a plain number or an angle: divided by 100, say, where 100 {scale.unit} are meant",
        shown(argument),
    )


def length_scale(dimensions: Mapping[str, int | None]) -> Scale:
    """Exponents of length of names: None, or no entry, is unknown."""
    return Scale(known=dimensions, words=dimension_name, unit="mm")


WORDS = {
    DEGREE: {0: "what is not in degC", 1: "a temperature (degC)"},
    MINUTE: {0: "what is not in min", 1: "a time (min)"},
}


def base_scales(per: Mapping[str, Mapping[str, int | None]]) -> dict[str, Scale]:
    """Of temperature and time, by exponents `per` them of all names."""

    def words(base: str) -> Callable[[float], str]:
        return lambda found: WORDS[base].get(int(found), f"{base}^{found:g}")

    units = {DEGREE: "degC", MINUTE: "min"}
    return {
        base: Scale(known=known, words=words(base), unit=units[base], literal=lambda _: UNKNOWN)
        for base, known in per.items()
    }


def shown(node: Node) -> str:
    """A term as a message shows it."""
    text = to_text(node)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


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


def exponent(node: Node, scale: Scale) -> Exponent:
    """The exponent of a term, None where it is not known.

    Raises EquationError for a sum of two exponents.
    """
    match node:
        case Number():
            return UNKNOWN
        case Name(name):
            return scale.known.get(name)
        case Negative(operand):
            return exponent(operand, scale)
        case Call(function, arguments):
            own = [exponent(item, scale) for item in arguments]
            if function not in ("abs", "sqrt"):
                return 0
            return scale.times(own[0], 0.5 if function == "sqrt" else 1)
        case Binary("+" | "-", left, right, column):
            return _of_sum(left, right, column, scale)
        case Binary("**", base, power) if (value := literal_value(power)) is not None:
            return scale.times(exponent(base, scale), value)
        case Binary("*" | "/" as operator, left, right):
            return _of_product(left, right, operator, scale)
    return UNKNOWN


def _of_product(left: Node, right: Node, operator: str, scale: Scale) -> Exponent:
    # A literal factor is a pure number: 127*ey_x stays an angle, and is told so.
    first, second = _of_factor(left, scale), _of_factor(right, scale)
    if first is UNKNOWN or second is UNKNOWN:
        return UNKNOWN
    return first + second if operator == "*" else first - second


def _of_factor(node: Node, scale: Scale) -> Exponent:
    value = literal_value(node)
    return exponent(node, scale) if value is None else scale.literal(value)


def literal_value(node: Node) -> float | None:
    """The value of a number, which a template that was filled in may have negated."""
    match node:
        case Number(value):
            return value
        case Negative(operand):
            inner = literal_value(operand)
            return None if inner is None else -inner
    return None


def _of_sum(left: Node, right: Node, column: int, scale: Scale) -> Exponent:
    first, second = exponent(left, scale), exponent(right, scale)
    # What is added to 1 is a plain number: in 1 + x/500 the 500 may be mm.
    for literal, other in ((left, right), (right, left)):
        if literal_value(literal) in (1.0, -1.0) and _has_literal_factor(other):
            return UNKNOWN
    return _sum(first, second, column, scale)


def _has_literal_factor(node: Node) -> bool:
    match node:
        case Negative(operand):
            return _has_literal_factor(operand)
        case Binary("*" | "/", left, right):
            factors = (left, right)
            return any(literal_value(f) is not None or _has_literal_factor(f) for f in factors)
    return False


def _sum(
    left: Exponent, right: Exponent, column: int, scale: Scale, verb: str = "are added"
) -> Exponent:
    if left is UNKNOWN:
        return right
    if right is UNKNOWN or math.isclose(left, right, abs_tol=SAME):
        return left
    raise EquationError(
        f"{scale.words(left)} and {scale.words(right)} {verb}", column, "terms of one dimension"
    )
