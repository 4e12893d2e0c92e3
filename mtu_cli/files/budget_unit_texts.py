"""What the units of a budget are called: as its file calls them, or by products of those."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from mtu_cli.files.unit_text import SIZE, Exponents, unit_exponents
from mtu_cli.language.dimensions import SAME

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
HALF_TURN = (("180", 180.0), ("10800", 10800.0), ("648000", 648000.0))
"""In degrees, minutes and seconds of arc."""
FACTORS = 3
"""Units of inputs, at most, by which another one is told."""
MOST = 8
"""Of so many of them: there are ever more products."""
_ONE = re.compile(r"[^\s*./()\d][^\s*./()]*")
"""A unit that may stand in a product: of um/m*K nobody knows what is meant."""
_NAME = re.compile(r"[A-Za-z%\u00b0\u00b5\u03bc\u2126\u03a9]+")
PLAIN, RADIANS = "plain numbers", "rad"
"""What has no unit is called, and what it is called beside an angle."""
BARE = "units of"
"""How a unit begins that is told by base units."""
LEAST, ROUNDED = 0.9e-6, 1e-9
"""Of a factor that is told as a divisor, and how near to a whole number that is."""


@dataclass(frozen=True, slots=True)
class UnitTexts:
    """Units by their text, of which some are `stated` by the file. A g is taken for `gram`."""

    named: Mapping[str, Exponents | None]
    stated: Sequence[str]
    gram: Exponents

    def text(self, found: Exponents) -> str:
        """A unit as the file calls it, or by those that it does (arcsec*mm), or in base units."""
        if not differ(found, {}) and abs(found[SIZE]) < SAME:
            return PLAIN
        for text, item in self.named.items():
            if item is not None and same(found, item):
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
                if same(found, _multiplied(first, *others)):
                    return "".join(text for text, _ in (first, *others)).removeprefix("*")
        return None

    def two(self, one: Exponents, other: Exponents) -> list[str]:
        """Two units that are to be one: plain numbers beside an angle are an angle, in rad."""
        texts = [self.text(one), self.text(other)]
        if any(text in ANGLES for text in texts):
            return [RADIANS if text == PLAIN else text for text in texts]
        return texts

    def like(self, stated: str, found: Exponents) -> tuple[str, str] | None:
        """A unit as the `stated` one with one of its units as inputs have it, N*mm for N*m; and
        what those inputs would be instead.
        """
        for part in _NAME.finditer(stated):
            own = unit_exponents(part[0], self.gram)
            for text in self.stated if own is not None else ():
                item = self.named.get(text)
                if item is None or own is None or differ(item, own) or not _NAME.fullmatch(text):
                    continue
                like = stated[: part.start()] + text + stated[part.end() :]
                exponents = unit_exponents(like, self.gram)
                if exponents is not None and same(exponents, found):
                    return like, f"inputs in {part[0]} instead of {text}"
        return None


def _multiplied(*factors: tuple[str, Exponents]) -> dict[str, float]:
    """Exponents of a product of factors that are told as `*mm` or `/min`."""
    return {
        base: sum(item.get(base, 0.0) * (-1.0 if text[0] == "/" else 1.0) for text, item in factors)
        for base in BASES
    }


def differ(one: Exponents, other: Exponents) -> bool:
    """Whether two units are of different dimensions, whatever their sizes."""
    return any(abs(one.get(base, 0.0) - other.get(base, 0.0)) > SAME for base in BASES[:-1])


def same(one: Exponents, other: Exponents) -> bool:
    """Whether two units are one, whatever they are called."""
    return not differ(one, other) and not sizes_differ(one, other)


def sizes_differ(one: Exponents, other: Exponents) -> bool:
    """Whether two units of one dimension are not the same; of several dimensions they may be."""
    return not differ(one, other) and abs(one[SIZE] - other[SIZE]) > SAME


def times(logarithm: float) -> str:
    """A factor in words: times 0.0254, times pi/180, divided by 1000."""
    ratio = 10.0**logarithm
    for text, value in HALF_TURN:
        if math.isclose(ratio, value / math.pi, rel_tol=SAME):
            return f"times {text}/pi"
        if math.isclose(ratio, math.pi / value, rel_tol=SAME):
            return f"times pi/{text}"
    below = round(1.0 / ratio) if LEAST < ratio < 1.0 else 0
    if below and math.isclose(below * ratio, 1.0, rel_tol=ROUNDED):
        return f"divided by {below}"
    return f"times {ratio:.6g}"
