"""Covariates: their names, directions and temperatures, and what each is measured in."""

from __future__ import annotations

import re

from mtu_cli.units import ANY, Powers, internal

POSITIONS = ("x", "y", "z")
DIRECTIONS = ("dir_x", "dir_y", "dir_z")
COVARIATES = (*DIRECTIONS, "time_min", "sequence")
SIGN_WORDS = {"forward": 1, "+": 1, "1": 1, "+1": 1, "reverse": -1, "-": -1, "-1": -1}
SIGN_EXPECTED = "forward or reverse, + or -, 1 or -1"
TEMPERATURE_EXPECTED = "a number in degC: leave out the column, or the rows"
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-"})
"""What a word processor makes of a minus: as a sign it can mean nothing else."""
SENSOR_DEGC = (-60.0, 150.0)
"""No sensor of a machine reads less or more; what a shop is in kelvin is more."""
NUMBER = internal()
_DIMENSIONS = (
    dict.fromkeys((*DIRECTIONS, "sequence"), NUMBER)
    | dict.fromkeys(POSITIONS, internal(length=1))
    | {"time_min": internal(minute=1)}
)
_TEMPERATURE = re.compile(r"T_\w+_degC", re.ASCII)


def is_covariate(name: str) -> bool:
    """Whether a name is a covariate of every machine: dir_x, time_min, T_spindle_degC, ..."""
    return name in COVARIATES or is_temperature(name)


def is_temperature(name: str) -> bool:
    """Whether a name is that of a sensor's temperature: T_spindle_degC, ..."""
    return _TEMPERATURE.fullmatch(name) is not None


def direction_sign(label: str) -> int | None:
    """+1 for forward, -1 for reverse, None for anything else; a number as its value.

    >>> direction_sign("Reverse"), direction_sign("1.0"), direction_sign("up")
    (-1, 1, None)
    """
    plain = label.strip().casefold().translate(_MINUS).replace(",", ".")
    if plain in SIGN_WORDS:
        return SIGN_WORDS[plain]
    try:
        value = float(plain)
    except ValueError:
        return None
    return int(value) if abs(value) == 1.0 and "_" not in plain else None


def column_dimensions(name: str) -> Powers:
    """Those of a position or a column of the contract; any for other columns of a user, whatever
    their names end with: an effect's parameter has its unit for each step of such a column.
    """
    return internal(degree=1) if is_temperature(name) else _DIMENSIONS.get(name, ANY)
