"""Units of the contract, internal ones (mm, rad, degC, min), and units as powers of base units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan, log10, nan, pi

LENGTH = 1
"""Dimension of a length as its exponent; an angle (and um/m) has 0."""
ANGLE = 0
DEGREE, MINUTE = "K", "min"
"""What the parameter of an effect may be per, beside lengths."""


BASES = ("m", "kg", "s", "A", "K")
_INTERNAL = ("mm", "kg", "min", "A", "K")
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Powers:
    """A unit as `exponents` of m, kg, s, A and K, and last the common logarithm of its size, which
    multiplies as they do. nan is not known, and agrees with anything.

    Of internal units, each base has one alone: their size is not known, nor wanted.
    """

    exponents: tuple[float, ...]

    def __mul__(self, other: Powers) -> Powers:
        return Powers(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __truediv__(self, other: Powers) -> Powers:
        return self * other**-1.0

    def __pow__(self, power: float) -> Powers:
        return Powers(tuple(own * power for own in self.exponents))

    def __or__(self, other: Powers) -> Powers:
        """What is known of either."""
        pairs = zip(self.exponents, other.exponents, strict=True)
        return Powers(tuple(b if isnan(a) else a for a, b in pairs))

    @property
    def size(self) -> float:
        """The common logarithm of its size."""
        return self.exponents[-1]

    @property
    def minute(self) -> float:
        """The exponent of time."""
        return self.exponents[BASES.index("s")]

    @property
    def known(self) -> bool:
        """Whether all is known but its size."""
        return not any(map(isnan, self.exponents[:-1]))

    def alike(self, other: Powers) -> bool:
        """Whether both are of one dimension, as far as they are known."""
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
        ('1e+06 kg/(m*s^2)', 'K/mm')
        """
        if not self.alike(PLAIN) or (not isnan(self.size) and abs(self.size) > _SAME):
            for name, own in (names or {}).items():
                if own.known and self.agrees(own):
                    return name
        bases = _INTERNAL if isnan(self.size) else BASES
        powers = {
            base: own
            for base, own in zip(bases, self.exponents, strict=False)
            if own and not isnan(own)
        }
        if isnan(self.size) and (word := _WORDS.get(tuple(powers.items()))):
            return word
        over, under = (
            [
                base if abs(own) == 1 else f"{base}^{abs(own):g}"
                for base, own in powers.items()
                if own * sign > 0
            ]
            for sign in (1, -1)
        )
        text = "*".join(over) or ("1" if under else "")
        if under:
            text += "/" + (under[0] if len(under) == 1 else f"({'*'.join(under)})")
        factor = "" if isnan(self.size) or abs(self.size) < _SAME else f"{10.0**self.size:.6g}"
        return " ".join(filter(None, (factor, text))) or "a plain number"


_WORDS: dict[tuple[tuple[str, float], ...], str] = {
    (): "an angle or ratio (rad)",
    (("mm", 1),): "a length (mm)",
    (("K", 1),): "a temperature (degC)",
    (("min", 1),): "a time (min)",
}
PLAIN = Powers((0.0,) * 6)
ANY = Powers((nan,) * 6)


def internal(length: float = 0, degree: float = 0, minute: float = 0) -> Powers:
    """Powers of mm, K and min."""
    return Powers((length, 0.0, minute, 0.0, degree, nan))


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of a reading: `to_internal` times a number of it gives mm or rad.

    `per`: K or min, where it is a unit of an effect's parameter per kelvin or time.
    """

    name: str
    dimension: int
    to_internal: float
    per: str | None = None

    @property
    def powers(self) -> Powers:
        """Its powers of the internal units."""
        return internal(self.dimension, -(self.per == DEGREE), -(self.per == MINUTE))


UNITS: dict[str, Unit] = {
    unit.name: unit
    for unit in (
        Unit("um", LENGTH, 1e-3),
        Unit("mm", LENGTH, 1.0),
        Unit("nm", LENGTH, 1e-6),
        Unit("arcsec", ANGLE, pi / 648000.0),
        Unit("urad", ANGLE, 1e-6),
        Unit("mrad", ANGLE, 1e-3),
        Unit("rad", ANGLE, 1.0),
        Unit("deg", ANGLE, pi / 180.0),
        Unit("um/m", ANGLE, 1e-6),
    )
}

UM = UNITS["um"].to_internal
ARCSEC = UNITS["arcsec"].to_internal

_MICRO = str.maketrans({"\u00b5": "u", "\u03bc": "u"})
"""The sign for micro and the Greek letter, which look alike."""


def plain_unit(text: str) -> str:
    """A unit with u for either sign of micro, as the names of UNITS have it."""
    return text.strip().translate(_MICRO)


def dimension_name(dimension: float) -> str:
    """A dimension in words; `dimension` is the exponent of length."""
    return internal(dimension).text()


_PER = {
    "/m": (-1, 1e-3, None),
    "/m^2": (-2, 1e-6, None),
    "/m^3": (-3, 1e-9, None),
    "/K": (0, 1.0, DEGREE),
    "/m/K": (-1, 1e-3, DEGREE),
    "/min": (0, 1.0, MINUTE),
    "/h": (0, 1.0 / 60.0, MINUTE),
    "/m/min": (-1, 1e-3, MINUTE),
    "/m/h": (-1, 1e-3 / 60.0, MINUTE),
}
"""Dimension and internal size (mm, degC, min) of what the parameter of an effect may be per, and
whether it is per kelvin or time."""

PARAMETER_UNITS: dict[str, Unit] = UNITS | {
    unit.name: unit
    for base in (UNITS["um"], UNITS["arcsec"], UNITS["urad"])
    for per, (dimension, size, of) in _PER.items()
    if (unit := Unit(base.name + per, base.dimension + dimension, base.to_internal * size, of)).name
    not in UNITS
}
"""Units of the parameters of effects: those of readings, and these per length, kelvin or time."""


def parameter_units_of(powers: Powers, like: str) -> list[str]:
    """Units of parameters of these powers, with the numerator of the unit `like` if there are such.

    >>> parameter_units_of(UNITS["um"].powers / internal(minute=1), "um")
    ['um/min', 'um/h']
    """
    found = [name for name, own in PARAMETER_UNITS.items() if own.powers.agrees(powers)]
    numerator = like.partition("/")[0]
    alike = [name for name in found if name.partition("/")[0] == numerator]
    return alike or [name for name in found if not name.startswith("arcsec")] or found


def um_text(value: float) -> str:
    """mm in micrometres, of two significant digits, for messages."""
    return f"{float(f'{value / UM:.2g}'):g}"


def p_text(p: float) -> str:
    """A p value for messages: "p = 0.012", "p <0.001"."""
    return "p <0.001" if p < 1e-3 else f"p = {p:.3f}"


_PREFIXES = {"": 0, "p": -12, "n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9}
_PREFIXED = {
    "m": "m", "s": "s", "A": "A", "K": "K", "V": "m2 kg s-3 A-1", "ohm": "m2 kg s-3 A-2",
    "W": "m2 kg s-3", "J": "m2 kg s-2", "N": "m kg s-2", "Pa": "m-1 kg s-2", "Hz": "s-1", "rad": "",
}  # fmt: skip
"""Units that take a prefix, in base units."""
_OTHER = {
    "1": (1.0, ""), "kg": (1.0, "kg"), "mg": (1e-6, "kg"), "degC": (1.0, "K"), "min": (60.0, "s"),
    "h": (3600.0, "s"), "cm": (1e-2, "m"), "dm": (0.1, "m"), "in": (0.0254, "m"),
    "mil": (2.54e-5, "m"), "L": (1e-3, "m3"), "mL": (1e-6, "m3"), "ml": (1e-6, "m3"),
    "bar": (1e5, "m-1 kg s-2"), "mbar": (1e2, "m-1 kg s-2"), "hPa": (1e2, "m-1 kg s-2"),
    "deg": (pi / 180, ""), "arcmin": (pi / 10800, ""), "arcsec": (pi / 648000, ""),
    "%": (1e-2, ""), "ppm": (1e-6, ""), "ppb": (1e-9, ""),
}  # fmt: skip
"""What may be several things has no entry: g (gram or free fall), C, F, T, l."""
_SYNONYMS = {
    "micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um", "inch": "in",
    "inches": "in", "mils": "mil", "thou": "mil", "degree": "deg", "degrees": "deg",
    "arcminute": "arcmin", "arcminutes": "arcmin", "arcsecond": "arcsec", "arcseconds": "arcsec",
    "radian": "rad", "radians": "rad", "kelvin": "K", "celsius": "degC", "meter": "m",
    "metre": "m", "millimeter": "mm", "millimetre": "mm", "second": "s", "seconds": "s",
    "minute": "min", "minutes": "min", "hour": "h", "hours": "h", "volt": "V", "newton": "N",
    "pascal": "Pa", "percent": "%",
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

    An angle is a number (rad); degC and K are one: differences are meant. Of um/m*K nobody knows
    what stands under the line: it is unknown, um/(m*K) is not.

    >>> unit_powers("um/(m K)") == unit_powers("ppm/degC"), unit_powers("um/m*K") == ANY
    (True, True)
    """
    if text is None or not text.strip() or len(text) > _LONGEST:
        return ANY
    plain = text.strip()
    for sign, meant in _SIGNS.items():
        plain = plain.replace(sign, meant)
    plain = _UNDER.sub(lambda found: "/" + "/".join(_BETWEEN.split(found[1].strip())), plain)
    powers, position = PLAIN, 0
    while position < len(plain):
        match = _FACTOR.match(plain, position)
        divides = match is not None and "/" in match[1]
        if match is None or ("/" in plain[:position] and not divides):
            return ANY
        powers *= _symbol(match[2]) ** (float(match[3] or 1) * (-1.0 if divides else 1.0))
        position = match.end()
    return powers if powers.known else ANY


def _symbol(name: str) -> Powers:
    name = _SYNONYMS.get(name.casefold(), name)
    if name in _OTHER:
        size, bases = _OTHER[name]
        return _base_units(bases, log10(size))
    for symbol, bases in _PREFIXED.items():
        prefix = name.removesuffix(symbol)
        # Nobody measures in giga-radians: Grad is a degree, or a gon.
        if name.endswith(symbol) and prefix in _PREFIXES and name not in ("krad", "Mrad", "Grad"):
            return _base_units(bases, _PREFIXES[prefix])
    return ANY


def _base_units(text: str, size: float) -> Powers:
    found = dict.fromkeys(BASES, 0.0)
    for base, exponent in re.findall(r"([A-Za-z]+)(-?[0-9]*)", text):
        found[base] = float(exponent or 1)
    return Powers((*found.values(), size))
