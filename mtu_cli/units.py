"""Units of the contract, internal ones (mm, rad, degC, min), and units as powers of base units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan, log10, nan, pi

LENGTH = 1
"""Dimension of a length as its exponent; an angle (and um/m) has 0."""
ANGLE = 0
BASES = ("m", "kg", "s", "A", "K")
_INTERNAL = ("mm", "kg", "min", "A", "K")
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Powers:
    """A unit as `exponents` of m, kg, s, A and K, and last the common logarithm of its size, which
    multiplies as they do. nan is not known, and agrees with anything.

    Each base has one internal unit alone: the size of internal units is nan.
    """

    exponents: tuple[float, ...]

    def __mul__(self, other: Powers) -> Powers:
        return Powers(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __truediv__(self, other: Powers) -> Powers:
        return self * other**-1.0

    def __pow__(self, power: float) -> Powers:
        return Powers(tuple(n * power for n in self.exponents))

    def __or__(self, other: Powers) -> Powers:
        """These exponents, and those of `other` where they are nan."""
        pairs = zip(self.exponents, other.exponents, strict=True)
        return Powers(tuple(b if isnan(a) else a for a, b in pairs))

    @property
    def size(self) -> float:
        """The common logarithm of its size."""
        return self.exponents[-1]

    @property
    def known(self) -> bool:
        """Whether no exponent is nan, but for the size."""
        return not any(map(isnan, self.exponents[:-1]))

    @property
    def whole(self) -> Powers:
        """With nan in place of broken exponents."""
        return Powers(tuple(n if n == round(n, 0) else nan for n in self.exponents))

    def alike(self, other: Powers) -> bool:
        """Whether both are of one dimension; nan agrees with all."""
        return not any(self._differences(other)[:-1])

    def agrees(self, other: Powers) -> bool:
        """Whether both may be one unit."""
        return not any(self._differences(other))

    def _differences(self, other: Powers) -> list[bool]:
        pairs = zip(self.exponents, other.exponents, strict=True)
        return [abs(a - b) > _SAME for a, b in pairs]

    def text(self, names: Mapping[str, Powers] | None = None) -> str:
        """The unit by one of `names`, or in base units.

        >>> unit_powers("N/mm^2").text(), internal(length=-1, degree=1).text()
        ('1e+06 m^-1*kg*s^-2', 'mm^-1*K')
        """
        sized = not isnan(self.size)
        factor = [f"{10.0**self.size:.6g}"] if sized and abs(self.size) > _SAME else []
        if factor or not self.alike(PLAIN):
            for name, unit in (names or {}).items():
                if unit.known and self.agrees(unit):
                    return name
        pairs = zip(BASES if sized else _INTERNAL, self.exponents, strict=False)
        powers = [(base, n) for base, n in pairs if n and not isnan(n)]
        bases = "*".join(base if n == 1 else f"{base}^{n:g}" for base, n in powers)
        text = " ".join(filter(None, (*factor, bases)))
        return text or "a plain number" if sized else _WORDS.get(text, text)


_WORDS = {
    "": "an angle or ratio (rad)",
    "mm": "a length (mm)",
    "K": "a temperature (degC)",
    "min": "a time (min)",
}
PLAIN = Powers((0.0,) * 6)
ANY = Powers((nan,) * 6)


def internal(length: float = 0, degree: float = 0, minute: float = 0) -> Powers:
    """Powers of mm, K and min."""
    return Powers((length, 0.0, minute, 0.0, degree, nan))


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of a reading or of an effect's parameter: `to_internal` times a number of it gives
    these `powers` of the internal units.
    """

    name: str
    powers: Powers
    to_internal: float

    @property
    def dimension(self) -> int:
        """The exponent of length: 1, of angles 0."""
        return int(self.powers.exponents[0])


_LENGTHS = {"um": 1e-3, "mm": 1.0, "nm": 1e-6}
_ANGLES = {
    "arcsec": pi / 648000.0, "urad": 1e-6, "mrad": 1e-3, "rad": 1.0, "deg": pi / 180.0,
    "um/m": 1e-6,
}  # fmt: skip
UNITS: dict[str, Unit] = {
    name: Unit(name, internal(dimension), size)
    for dimension, sizes in ((LENGTH, _LENGTHS), (ANGLE, _ANGLES))
    for name, size in sizes.items()
}
"""Units of readings."""

UM = UNITS["um"].to_internal
ARCSEC = UNITS["arcsec"].to_internal
SMALL = {LENGTH: UNITS["um"], ANGLE: UNITS["arcsec"]}
"""The unit of an error of either dimension, where none is stated."""


def plain_unit(text: str) -> str:
    """A unit in plain letters: u for either sign of micro, as the names of UNITS have it."""
    plain = text.strip()
    for sign, letters in _SIGNS.items():
        plain = plain.replace(sign, letters)
    return plain


_PER = {
    "/m": (internal(-1), 1e-3), "/m^2": (internal(-2), 1e-6), "/m^3": (internal(-3), 1e-9),
    "/K": (internal(degree=-1), 1.0), "/m/K": (internal(-1, degree=-1), 1e-3),
    "/min": (internal(minute=-1), 1.0), "/h": (internal(minute=-1), 1.0 / 60.0),
    "/m/min": (internal(-1, minute=-1), 1e-3), "/m/h": (internal(-1, minute=-1), 1e-3 / 60.0),
}  # fmt: skip
"""Powers and internal size of what the parameter of an effect may be per."""

PARAMETER_UNITS: dict[str, Unit] = UNITS | {
    base + per: Unit(base + per, UNITS[base].powers * powers, UNITS[base].to_internal * size)
    for base in ("um", "arcsec", "urad")
    for per, (powers, size) in _PER.items()
    if base + per not in UNITS
}
"""Units of the parameters of effects: those of readings, and these per length, kelvin or time."""


def parameter_units_of(powers: Powers, like: str) -> list[str]:
    """Units of parameters of these powers, with the numerator of the unit `like` if there are such.

    >>> parameter_units_of(UNITS["um"].powers / internal(minute=1), "um")
    ['um/min', 'um/h']
    """
    result = [name for name, unit in PARAMETER_UNITS.items() if unit.powers.agrees(powers)]
    numerator = like.partition("/")[0]
    matches = [name for name in result if name.partition("/")[0] == numerator]
    return matches or [name for name in result if not name.startswith("arcsec")] or result


_PREFIXES = {"": 0, "p": -12, "n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9}
_PREFIXED = {
    "m": (1,), "s": (0, 0, 1), "A": (0, 0, 0, 1), "K": (0, 0, 0, 0, 1), "V": (2, 1, -3, -1),
    "ohm": (2, 1, -3, -2), "W": (2, 1, -3), "J": (2, 1, -2), "N": (1, 1, -2), "Pa": (-1, 1, -2),
    "Hz": (0, 0, -1),
}  # fmt: skip
"""Units that take a prefix, as exponents of m, kg, s, A and K."""
_OTHER = {
    "1": (1.0,), "rad": (1.0,), "mrad": (1e-3,), "urad": (1e-6,), "deg": (pi / 180,),
    "arcmin": (pi / 10800,), "arcsec": (pi / 648000,), "%": (1e-2,), "ppm": (1e-6,),
    "ppb": (1e-9,), "kg": (1.0, 0, 1), "mg": (1e-6, 0, 1), "degC": (1.0, 0, 0, 0, 0, 1),
    "min": (60.0, 0, 0, 1), "h": (3600.0, 0, 0, 1), "cm": (1e-2, 1), "dm": (0.1, 1),
    "in": (0.0254, 1), "mil": (2.54e-5, 1), "L": (1e-3, 3), "mL": (1e-6, 3), "ml": (1e-6, 3),
    "bar": (1e5, -1, 1, -2), "mbar": (1e2, -1, 1, -2), "hPa": (1e2, -1, 1, -2),
}  # fmt: skip
"""Size and exponents. What may be several things has no entry: g (gram or free fall), C, F, T, l,
Grad (a degree, or a gon)."""
_SYNONYMS = {
    "micron": "um", "microns": "um", "inch": "in", "inches": "in", "thou": "mil", "degree": "deg",
    "degrees": "deg", "kelvin": "K", "celsius": "degC", "metre": "m", "meter": "m",
    "second": "s", "minute": "min", "hour": "h", "percent": "%",
}  # fmt: skip
_SIGNS = {
    "\u00b0C": "degC", "\u2103": "degC", "\u00b0": "deg", "\u00b5": "u", "\u03bc": "u",
    "\u2126": "ohm", "\u03a9": "ohm", "\u00b2": "2", "\u00b3": "3", "\u00b7": "*",
    "\u2212": "-", "**": "^",
}  # fmt: skip
_UNDER = re.compile(r"/\s*\(([^()/]+)\)$")
_BETWEEN = re.compile(r"\s*[*.]\s*|\s+")
_FACTOR = re.compile(r"(^|\s*[*/.]\s*|\s+)([A-Za-z%]+|1)(?:\^?([+-]?[0-9]+))?")
_LONGEST = 60


def unit_powers(text: str | None) -> Powers:
    """A unit as people write it (mm, 1/degC, um/m/K, kg m^2/s2); `ANY` for an unknown one.

    An angle is a number (rad); degC and K are one: differences are meant. um/m*K is ambiguous
    and so unknown, um/(m*K) is not.

    >>> unit_powers("um/(m K)") == unit_powers("ppm/degC"), unit_powers("um/m*K") == ANY
    (True, True)
    """
    plain = plain_unit(text or "")
    if not plain or len(plain) > _LONGEST:
        return ANY
    plain = _UNDER.sub(lambda match: "/" + "/".join(_BETWEEN.split(match[1].strip())), plain)
    powers, position = PLAIN, 0
    while position < len(plain):
        match = _FACTOR.match(plain, position)
        divides = match is not None and "/" in match[1]
        if match is None or ("/" in plain[:position] and not divides):
            return ANY
        unit = _SYMBOLS.get(_SYNONYMS.get(match[2].casefold(), match[2]), ANY)
        powers *= unit ** (float(match[3] or 1) * (-1.0 if divides else 1.0))
        position = match.end()
    return powers if powers.known else ANY


def _powers(size: float, *exponents: float) -> Powers:
    return Powers((*map(float, exponents), *[0.0] * (len(BASES) - len(exponents)), size))


_SYMBOLS = {
    prefix + symbol: _powers(size, *exponents)
    for symbol, exponents in _PREFIXED.items()
    for prefix, size in _PREFIXES.items()
} | {name: _powers(log10(size), *exponents) for name, (size, *exponents) in _OTHER.items()}
