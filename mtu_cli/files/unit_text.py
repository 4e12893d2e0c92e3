"""Units as people write them (mm, 1/degC, um/m/K, kg m^2/s2), as exponents of base units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

SIZE = "size"
"""Key of the common logarithm of a unit's size in base units: it adds as exponents do."""
Exponents = Mapping[str, float]

_PREFIXES = {"": 0, "p": -12, "n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9}
_SOME_PREFIXES = {"m": {"c": -2, "d": -1}, "Pa": {"h": 2}, "bar": {}}
_WITH_PREFIX: dict[str, dict[str, float]] = {
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "J": {"kg": 1, "m": 2, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "bar": {"kg": 1, "m": -1, "s": -2, SIZE: 5},
    "Hz": {"s": -1},
    "rad": {},
}
_ANGLE = math.pi / 180
_PLAIN: dict[str, dict[str, float]] = {
    "1": {},
    "kg": {"kg": 1},
    "mg": {"kg": 1, SIZE: -6},
    "L": {"m": 3, SIZE: -3},
    "mL": {"m": 3, SIZE: -6},
    "ml": {"m": 3, SIZE: -6},
    "degC": {"K": 1},
    "min": {"s": 1, SIZE: math.log10(60)},
    "h": {"s": 1, SIZE: math.log10(3600)},
    "in": {"m": 1, SIZE: math.log10(0.0254)},
    "mil": {"m": 1, SIZE: math.log10(0.0254e-3)},
    "deg": {SIZE: math.log10(_ANGLE)},
    "arcmin": {SIZE: math.log10(_ANGLE / 60)},
    "arcsec": {SIZE: math.log10(_ANGLE / 3600)},
    "%": {SIZE: -2},
    "ppm": {SIZE: -6},
    "ppb": {SIZE: -9},
}
"""What may be several things has no entry: g (see `GRAMS`), C, F, T, l. Nor have
ft and gon: 12 in and 9/10 deg, numbers that equations hold for other reasons too.
"""
GRAMS: tuple[Exponents, Exponents] = (
    {"kg": 1, SIZE: -3},
    {"m": 1, "s": -2, SIZE: math.log10(9.80665)},
)
"""What g may be: the gram, or the acceleration of free fall. A fault of both is one."""
LENGTHS_ALSO = {
    "micron": "um", "microns": "um", "inch": "in", "inches": "in", "zoll": "in", "mils": "mil",
    "thou": "mil", "feet": "ft",
}  # fmt: skip
"""Words for units of length, in lower case: other than symbols they may have capitals."""
_ALSO = LENGTHS_ALSO | {
    "degree": "deg", "degrees": "deg", "arcminute": "arcmin",
    "arcminutes": "arcmin", "arcsecond": "arcsec", "arcseconds": "arcsec", "radian": "rad",
    "radians": "rad", "kelvin": "K", "celsius": "degC",
    "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "micrometer": "um", "micrometers": "um", "micrometre": "um", "micrometres": "um",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "second": "s", "seconds": "s",
    "newton": "N", "newtons": "N", "pascal": "Pa", "volt": "V", "volts": "V", "ohm": "ohm",
    "ohms": "ohm", "percent": "%", "sec": "s", "minute": "min", "minutes": "min", "mins": "min",
    "hour": "h", "hours": "h",
}  # fmt: skip
WORDS = tuple(_ALSO)
"""Words for units, in lower case."""
_DEGREES = re.compile(r"(?:deg(?:rees?)?|\u00b0)\s*(?:celsius|kelvin|[ck])(?![a-z])", re.IGNORECASE)
_UNDER = re.compile(r"/\s*\(([^()/]+)\)(?!\s*(?:\^|\*\*|[\d\u00b2\u00b3]))")
"""What is divided by as one: um/(m K); a power of it as a whole is not read."""
_BETWEEN = re.compile(r"\s*(?:(?<!\*)\*(?!\*)|\.(?!\d))\s*|\s+")
_SIGNS = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u2126": "ohm", "\u03a9": "ohm",
                        "\u00b2": "2", "\u00b3": "3", "\u00b7": "*", "\u2212": "-"})  # fmt: skip
_FACTOR = re.compile(
    r"(?P<before>^|\s*[*/.]\s*|\s+)(?:(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z%]+))"
    r"(?:(?:\^|\*\*)?(?P<power>[+-]?\d+))?",
    re.ASCII,
)
_DENSITY = re.compile(r"\s*g\s*/\s*[munckd]?m\s*(?:\^|\*\*)?\s*[23\u00b2\u00b3]")
"""Here g is the gram: nobody divides an acceleration by a volume or an area."""
LONGEST = 60


def grams(texts: Iterable[str | None]) -> tuple[Exponents, ...]:
    """What g may be in a file with these units: of `GRAMS` those that none of them rules out."""
    return GRAMS[:1] if any(_DENSITY.match(text) for text in texts if text) else GRAMS


def unit_exponents(text: str | None, gram: Exponents | None = None) -> Exponents | None:
    """Exponents of the base units m, kg, s, A, K and of ten (`SIZE`); None for an unknown unit.

    `gram` is what g is taken for, one of `GRAMS`; it is unknown without. An angle is a number
    (rad), degC and K are one: differences are meant.
    """
    if text is None or len(text) > LONGEST:
        return None
    plain = _DEGREES.sub("degC", text.strip().replace("\u2103", "\u00b0C"))
    plain = plain.replace("\u00b0", "deg").translate(_SIGNS)
    plain = _UNDER.sub(lambda found: "/" + "/".join(_BETWEEN.split(found[1].strip())), plain)
    found: dict[str, float] = {SIZE: 0.0}
    position = 0
    while position < len(plain):
        match = _FACTOR.match(plain, position)
        own = None if match is None else _factor(match["number"], match["name"], gram)
        if match is None or own is None:
            return None
        if position and "/" not in match["before"] and "/" in plain[:position]:
            # What um/m*K means is anyone's guess.
            return None
        sign = -1.0 if "/" in match["before"] else 1.0
        power = sign * float(match["power"] or 1)
        for base, exponent in own.items():
            found[base] = found.get(base, 0.0) + power * exponent
        position = match.end()
    return found if position else None


def _factor(
    number: str | None, name: str | None, gram: Exponents | None
) -> Mapping[str, float] | None:
    if number is not None:
        return {SIZE: math.log10(float(number))} if float(number) > 0 else None
    if name is None:
        return None
    if name in ("g", "gram", "grams"):
        return gram
    name = _ALSO.get(name.casefold(), name)
    if name in _PLAIN:
        return _PLAIN[name]
    for symbol, own in _WITH_PREFIX.items():
        if name.endswith(symbol):
            prefix = name.removesuffix(symbol)
            size = (_PREFIXES | _SOME_PREFIXES.get(symbol, {})).get(prefix)
            # Nobody measures in giga-radians: Grad is a degree, or a gon.
            if size is not None and not (symbol == "rad" and size > 0):
                return own | {SIZE: own.get(SIZE, 0) + size}
    return None


def meant(text: str | None) -> str | None:
    """How a unit with more than one factor under its line, as um/m*K, is likely meant: um/(m K).

    None for one that is read, or that nobody knows.
    """
    if text is None or unit_exponents(text, GRAMS[0]) is not None:
        return None
    over, _, under = text.strip().partition("/")
    factors = _BETWEEN.split(under.strip().translate(_SIGNS))
    if "" in factors or any("-" in factor for factor in factors):
        return None
    clear = f"{over}/({' '.join(factors)})"
    return None if unit_exponents(clear, GRAMS[0]) is None else clear
