"""Dimensions of equations whose numbers may have units that are not written: ``0.004*dir_x``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mtu_cli.language.dimensions import (
    SAME,
    UNKNOWN,
    Scale,
    check_arguments,
    exponent,
    first_column,
    shown,
    terms,
)
from mtu_cli.language.errors import EquationError
from mtu_cli.language.tree import Node


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """One base quantity and the exponent of it that an equation is to have, None for any."""

    scale: Scale
    exponent: int | None


def check_with_free_literals(node: Node, wanted: Sequence[Wanted]) -> None:
    """Raises EquationError at the first term without a number among its factors whose exponents
    are not those `wanted`, at a sum of two dimensions, and at a function of plain numbers with an
    argument that is none. A term that is a plain number may stand for anything.
    """
    scales = [replace(item.scale, literal=lambda _: UNKNOWN) for item in wanted]
    for scale in scales:
        check_arguments(node, scale)
        exponent(node, scale)
    for term in terms(node):
        found = [exponent(term, scale) for scale in scales]
        known = [own for own in found if own is not UNKNOWN]
        if len(known) == len(found) and any(known):
            _check(term, known, wanted)


def _check(term: Node, found: Sequence[float], wanted: Sequence[Wanted]) -> None:
    asked = [own if item.exponent is None else item.exponent
             for own, item in zip(found, wanted, strict=True)]  # fmt: skip
    if all(abs(own - other) < SAME for own, other in zip(found, asked, strict=True)):
        return
    what = f"this term is {_words(found, wanted)}, its equation is {_words(asked, wanted)}"
    hint = "a number before it that has the unit of the rest, such as 0.004*"
    raise EquationError(what, first_column(term), hint, shown(term))


def _words(exponents: Sequence[float], wanted: Sequence[Wanted]) -> str:
    own = zip(exponents, wanted, strict=True)
    return " times ".join(item.scale.words(power) for power, item in own if power) or "a number"
