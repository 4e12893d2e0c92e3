"""Units of a budget: numbers are calculated with as they stand, so that their units must agree.

A factor other than a simple fraction or pi may have a unit that is not written, or change one
(``1000*V/I``, ``asin(h/L)*180/pi``): what holds one is left alone. So is what has inputs whose
unit is not stated or not known. A literal that is added has the unit of what it is added to.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

from mtu_cli.files.budget_unit_texts import (
    ANGLES,
    BARE,
    BASES,
    COMMON,
    PLAIN,
    RADIANS,
    UnitTexts,
    differ,
    same,
    sizes_differ,
    times,
)
from mtu_cli.files.unit_text import GRAMS, SIZE, Exponents, unit_exponents
from mtu_cli.language import EquationError, Node
from mtu_cli.language.dimensions import (
    NUMBERS,
    SAME,
    UNKNOWN,
    Exponent,
    Scale,
    exponent,
    first_column,
    shown,
    terms,
)
from mtu_cli.language.tree import Binary, Call, Number, children, walk

SIMPLE = 12
"""Numerator and denominator of the largest simple fraction."""


def _simple(value: float) -> Exponent:
    """0 for a literal that is a simple fraction, perhaps times a power of pi; else unknown."""
    if abs(value) != 1.0 and math.log10(abs(value) or 1.0) % 1.0 == 0.0:
        return UNKNOWN
    for power in range(-2, 3):
        for q in range(1, SIMPLE + 1):
            p = abs(value) / math.pi**power * q
            if abs(p - round(p)) < SAME and 1 <= round(p) <= SIMPLE:
                return 0
    return UNKNOWN


@dataclass(frozen=True, slots=True)
class BudgetUnits:
    """What the units of the inputs tell: a scale for each of `BASES`, and what they are called."""

    scales: Mapping[str, Scale]
    texts: UnitTexts

    @classmethod
    def of_inputs(cls, units: Mapping[str, str | None], gram: Exponents = GRAMS[0]) -> BudgetUnits:
        """From the stated unit of every input."""
        named = {text: unit_exponents(text, gram) for text in (*units.values(), *COMMON) if text}
        known = {name: None if text is None else named.get(text) for name, text in units.items()}
        scales = {
            base: Scale(
                known={
                    name: None if item is None else item.get(base, 0.0)
                    for name, item in known.items()
                },
                words=str,
                unit="",
                literal=_simple,
                whole=False,
            )
            for base in BASES
        }
        stated = tuple(dict.fromkeys(filter(None, units.values())))
        return cls(scales, UnitTexts(named, stated, gram))

    def faults(self, tree: Node, stated: str | None = None) -> Iterator[EquationError]:
        """Where numbers of different units are added, and where a function of plain numbers has
        others. Of two units the one that is not `stated` is told to be changed.
        """
        apart, wanted = self.disagree(tree), unit_exponents(stated, self.texts.gram)
        for node in walk(tree):
            match node:
                case Binary("+" | "-", left, right, column) if apart:
                    yield from self._pair(left, right, column, "are added", wanted)
                case Call("atan2", (left, right), column):
                    yield from self._pair(left, right, column, "are compared", wanted)
                case Call(function, (argument,)) if function in NUMBERS:
                    yield from self.plain(argument, f"{function} of numbers in")
                case Binary("**", _, power):
                    yield from self.plain(power, "an exponent in")

    def disagree(self, tree: Node) -> bool:
        """Whether some sum may have terms of different units: a look that costs little."""
        try:
            for scale in self.scales.values():
                exponent(tree, scale)
        except EquationError:
            return True
        return False

    def result_fault(self, tree: Node, stated: str | None) -> EquationError | None:
        """The fault of an equation that gives another unit than the `stated` one, if it does."""
        wanted = unit_exponents(stated, self.texts.gram)
        if stated is None or wanted is None:
            return None
        for sure in (True, False):
            found = self.of(tree, sure)
            if found is None:
                continue
            if differ(found, wanted) if sure else sizes_differ(found, wanted):
                return self._given(tree, found, stated, wanted)
        return None

    def _pair(
        self, left: Node, right: Node, column: int, verb: str, wanted: Exponents | None
    ) -> Iterator[EquationError]:
        for sure in (True, False):
            one, other = self.of(left, sure), self.of(right, sure)
            if one is None or other is None:
                continue
            if differ(one, other) if sure else sizes_differ(one, other):
                texts = self.texts.two(one, other)
                hint = "terms of one unit"
                if not differ(one, other):
                    off, changed = other[SIZE] - one[SIZE], texts[1]
                    if wanted is not None and same(other, wanted):
                        off, changed = -off, texts[0]
                    hint = f"one unit: what is in {changed} {times(off)}"
                yield EquationError(f"{texts[0]} and {texts[1]} {verb}", column, hint)
                return

    def plain(self, argument: Node, of: str) -> Iterator[EquationError]:
        for sure in (True, False):
            if sure and any(_literals(argument, added=True)):
                # Empirical equations take logarithms of numbers: log(t + 273.15).
                continue
            found = self.of(argument, sure)
            if found is None:
                continue
            if differ(found, {}) if sure else sizes_differ(found, {SIZE: 0.0}):
                hint = "a plain number, or an angle in rad"
                if not differ(found, {}):
                    hint += f": what is inside {times(found[SIZE])}"
                column = first_column(argument)
                yield EquationError(f"{of} {self.texts.text(found)}", column, hint, shown(argument))
                return

    def _given(self, tree: Node, found: Exponents, stated: str, wanted: Exponents) -> EquationError:
        """What an equation gives instead of the `stated` unit, and first how it would give that."""
        told = self.texts.text(found)
        ways = ["an equation that gives this unit"]
        if not differ(found, wanted):
            if stated.casefold().rstrip("s").endswith(ANGLES):
                told = told.replace(PLAIN, RADIANS)
            off = found[SIZE] - wanted[SIZE]
            ways = [] if self._has_shift(tree) else [f"{self._that_gives(tree)} {times(off)}"]
            if told.startswith(BARE):
                bare = (f"{BARE} {10.0**off:.6g} {stated}",)
                told, *others = self.texts.like(stated, found) or bare
                ways += others
        if not told.startswith(BARE) or not ways:
            ways.append(f"{told} here")
        return EquationError(f"the equation gives {told}", first_column(tree), ", or ".join(ways))

    def _that_gives(self, tree: Node) -> str:
        """What has the unit that an equation gives: beside terms of which nobody knows (da*60, to
        get arcsec from arcmin) it is one term.
        """
        own = [(term, self.of(term, sure=False)) for term in terms(tree)]
        known = [term for term, unit in own if unit is not None]
        return "the equation" if len(known) == len(own) else " and ".join(map(shown, known))

    def _has_shift(self, tree: Node) -> bool:
        """Whether a literal is added to plain numbers of another size, or to what is not known:
        1 + alpha*dT in ppm is no matter of a factor.
        """
        sums = [item for item in walk(tree) if isinstance(item, Binary) and item.operator in "+-"]
        sides = [pair for item in sums for pair in permutations((item.left, item.right))]
        beside = [self.of(other, sure=False) for side, other in sides if isinstance(side, Number)]
        return any(found is None or sizes_differ(found, {SIZE: 0.0}) for found in beside)

    def of(self, node: Node, sure: bool) -> dict[str, float] | None:
        """Exponents of what a term gives; None where they are not known, or disagree within it.

        Where it is to be `sure`, any factor may have a unit: exp(34 - 6292/T) may be in Pa.
        """
        if sure and any(_literals(node, added=False)):
            return None
        found = {}
        for base, scale in self.scales.items():
            try:
                value = exponent(node, scale)
            except EquationError:
                return None
            if value is None:
                return None
            found[base] = value
        return found


def _literals(node: Node, added: bool) -> Iterator[Node]:
    """Numbers of a term but for those of powers, and for those of sums unless `added`."""
    match node:
        case Number():
            yield node
        case Binary("**", base, Number()):
            yield from _literals(base, added)
        case Binary("+" | "-", left, right) if not added:
            for side in (left, right):
                if not isinstance(side, Number):
                    yield from _literals(side, added)
        case _:
            for item in children(node):
                yield from _literals(item, added)
