"""Units of the contract and the internal ones: mm, rad, degC, min."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

LENGTH = 1
"""Dimension of a length as its exponent; an angle (and um/m) has 0."""
ANGLE = 0
DEGREE, MINUTE = "K", "min"
"""What the parameter of an effect may be per, beside lengths."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of a reading: `to_internal` times a number of it gives mm or rad.

    `per`: K or min, where it is a unit of an effect's parameter per kelvin or time.
    """

    name: str
    dimension: int
    to_internal: float
    per: str | None = None


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


DIMENSION_NAMES: dict[float, str] = {LENGTH: "a length (mm)", ANGLE: "an angle or ratio (rad)"}


def dimension_name(dimension: float) -> str:
    """A dimension in words; `dimension` is the exponent of length."""
    return DIMENSION_NAMES.get(dimension, f"mm^{dimension:g}")


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


def um_text(value: float) -> str:
    """mm in micrometres, of two significant digits, for messages."""
    return f"{float(f'{value / UM:.2g}'):g}"


def p_text(p: float) -> str:
    """A p value for messages: "p = 0.012", "p <0.001"."""
    return "p <0.001" if p < 1e-3 else f"p = {p:.3f}"
