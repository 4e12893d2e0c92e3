"""Units of a budget: numbers are calculated with as they stand, so that their units must agree.

A factor other than a simple fraction or pi may have a unit that is not written, or change one
(``1000*V/I``, ``asin(h/L)*180/pi``): what holds one is left alone. So is what has inputs whose
unit is not stated or not known. A literal that is added has the unit of what it is added to.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

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
)
from mtu_cli.language.tree import Binary, Call, Number, children, walk

BASES = ("m", "kg", "s", "A", "K", SIZE)
TURNS = ("deg", "arcmin", "arcsec")
COMMON = (
    "mm", "um", "nm", "m", "km", "mm^2", "um^2", "m^2", "mm^3", "degC", "1/degC", "s", "ms", "m/s",
    "V", "mV", "kV", "A", "mA", "ohm", "kohm", "W", "mW", "N", "kN", "J", "Pa", "kPa", "MPa", "kg",
    "g", "g/mm^3", "g/cm^3", "kg/m^3", "%", "ppm", *TURNS,
)  # fmt: skip
"""What a unit is called that the file does not name."""
ANGLES = (
    "rad", "deg", "arcmin", "arcsec", "\u00b0", "radian", "degree", "arcminute", "arcsecond",
)  # fmt: skip
FACTORS = 3
"""Units of inputs, at most, by which another one is told."""
MOST = 8
"""Of so many of them: there are ever more products."""
_ONE = re.compile(r"[^\s*./()\d][^\s*./()]*")
"""A unit that may stand in a product: of um/m*K nobody knows what is meant."""
_NAME = re.compile(r"[A-Za-z%\u00b0\u00b5\u03bc\u2126\u03a9]+")
BARE = "units of"
"""How a unit begins that is told by base units."""
LEAST, ROUNDED = 0.9e-6, 1e-9
"""Of a factor that is told as a divisor, and how near to a whole number that is."""
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
    """What the units of the inputs tell: a scale for each of `BASES`, and units by their text, of
    which some are `stated`. A g is taken for `gram`.
    """

    scales: Mapping[str, Scale]
    named: Mapping[str, Exponents | None]
    stated: Sequence[str]
    gram: Exponents

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
        return cls(scales, named, tuple(dict.fromkeys(filter(None, units.values()))), gram)

    def faults(self, tree: Node) -> Iterator[EquationError]:
        """Where numbers of different units are added, and where a function of plain numbers has
        others.
        """
        apart = self.disagree(tree)
        for node in walk(tree):
            match node:
                case Binary("+" | "-", left, right, column) if apart:
                    yield from self.pair(left, right, column, "are added")
                case Call("atan2", (left, right), column):
                    yield from self.pair(left, right, column, "are compared")
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
        wanted = unit_exponents(stated, self.gram)
        if stated is None or wanted is None:
            return None
        for sure in (True, False):
            found = self.of(tree, sure)
            if found is None:
                continue
            if _differ(found, wanted) if sure else sizes_differ(found, wanted):
                return self._given(tree, found, stated, wanted)
        return None

    def pair(self, left: Node, right: Node, column: int, verb: str) -> Iterator[EquationError]:
        for sure in (True, False):
            one, other = self.of(left, sure), self.of(right, sure)
            if one is None or other is None:
                continue
            if _differ(one, other) if sure else sizes_differ(one, other):
                first, second = self.text(one), self.text(other)
                hint = "terms of one unit"
                if not _differ(one, other):
                    factor = times(other[SIZE] - one[SIZE])
                    hint = f"one unit: what is in {second} {factor}"
                yield EquationError(f"{first} and {second} {verb}", column, hint)
                return

    def plain(self, argument: Node, of: str) -> Iterator[EquationError]:
        for sure in (True, False):
            if sure and any(_literals(argument, added=True)):
                # Empirical equations take logarithms of numbers: log(t + 273.15).
                continue
            found = self.of(argument, sure)
            if found is None:
                continue
            if _differ(found, {}) if sure else sizes_differ(found, {SIZE: 0.0}):
                hint = "a plain number, or an angle in rad"
                if not _differ(found, {}):
                    hint += f": what is inside {times(found[SIZE])}"
                column = first_column(argument)
                yield EquationError(f"{of} {self.text(found)}", column, hint, shown(argument))
                return

    def _given(self, tree: Node, found: Exponents, stated: str, wanted: Exponents) -> EquationError:
        """What an equation gives instead of the `stated` unit, and first how it would give that."""
        told = self.text(found)
        ways = ["an equation that gives this unit"]
        if not _differ(found, wanted):
            angle = stated.casefold().rstrip("s").endswith(ANGLES)
            told = told.replace("plain numbers", "rad" if angle else "plain numbers")
            off = found[SIZE] - wanted[SIZE]
            ways = [] if self._has_shift(tree) else [f"the equation {times(off)}"]
            if told.startswith(BARE):
                told, *others = self._like(stated, found) or (f"{BARE} {10.0**off:.6g} {stated}",)
                ways += others
        if not told.startswith(BARE) or not ways:
            ways.append(f"{told} here")
        return EquationError(f"the equation gives {told}", first_column(tree), ", or ".join(ways))

    def _like(self, stated: str, found: Exponents) -> tuple[str, str] | None:
        """A unit as the `stated` one with one of its units as inputs have it, N*mm for N*m; and
        what those inputs would be instead.
        """
        for part in _NAME.finditer(stated):
            own = unit_exponents(part[0], self.gram)
            for text in self.stated if own is not None else ():
                item = self.named.get(text)
                if item is None or own is None or _differ(item, own) or not _NAME.fullmatch(text):
                    continue
                like = stated[: part.start()] + text + stated[part.end() :]
                exponents = unit_exponents(like, self.gram)
                if exponents is not None and _same(exponents, found):
                    return like, f"inputs in {part[0]} instead of {text}"
        return None

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

    def text(self, found: Exponents) -> str:
        """A unit as the file calls it, or by those that it does (arcsec*mm), or in base units."""
        if not _differ(found, {}) and abs(found[SIZE]) < SAME:
            return "plain numbers"
        for text, item in self.named.items():
            if item is not None and _same(found, item):
                return text
        if (told := self._product(found)) is not None:
            return told
        bases = [
            base if found[base] == 1 else f"{base}^{found[base]:g}"
            for base in BASES[:-1]
            if found[base]
        ]
        return " ".join([f"{BARE} {10.0 ** found[SIZE]:.6g}", *bases])

    def _product(self, found: Exponents) -> str | None:
        """A unit as the shortest product of those of the inputs; None where there is none."""
        texts = [text for text in self.stated if _ONE.fullmatch(text)][:MOST]
        units = {text: item for text in (*texts, *TURNS) if (item := self.named.get(text))}
        factors = [(f"{sign}{text}", item) for text, item in units.items() for sign in "*/"]
        for count in range(1, FACTORS):
            for first, *others in product(factors[::2], *[factors] * count):
                if _same(found, _multiplied(first, *others)):
                    return "".join(text for text, _ in (first, *others)).removeprefix("*")
        return None


def _multiplied(*factors: tuple[str, Exponents]) -> dict[str, float]:
    """Exponents of a product of factors that are told as `*mm` or `/min`."""
    return {
        base: sum(item.get(base, 0.0) * (-1.0 if text[0] == "/" else 1.0) for text, item in factors)
        for base in BASES
    }


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


def _differ(one: Exponents, other: Exponents) -> bool:
    return any(abs(one.get(base, 0.0) - other.get(base, 0.0)) > SAME for base in BASES[:-1])


def _same(one: Exponents, other: Exponents) -> bool:
    return not _differ(one, other) and not sizes_differ(one, other)


def sizes_differ(one: Exponents, other: Exponents) -> bool:
    """Whether two units of one dimension are not the same; of several dimensions they may be."""
    return not _differ(one, other) and abs(one[SIZE] - other[SIZE]) > SAME


def times(logarithm: float) -> str:
    """A factor in words: times 0.0254, times pi/180, divided by 1000."""
    ratio = 10.0**logarithm
    for text, value in (("180/pi", 180 / math.pi), ("pi/180", math.pi / 180)):
        if math.isclose(ratio, value, rel_tol=SAME):
            return f"times {text}"
    below = round(1.0 / ratio) if LEAST < ratio < 1.0 else 0
    if below and math.isclose(below * ratio, 1.0, rel_tol=ROUNDED):
        return f"divided by {below}"
    return f"times {ratio:.6g}"
