"""Covariates: their names, directions and temperatures, and what each is measured in."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING

from mtu_cli.findings import closest
from mtu_cli.units import Powers, internal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
SENSOR_EXPECTED = "degC, {:g} to {:g}".format(*SENSOR_DEGC)
NUMBER = internal()
PLACE = internal(length=1)
TEMPERATURE = internal(degree=1)
_DIMENSIONS = (
    dict.fromkeys((*DIRECTIONS, "sequence"), NUMBER)
    | dict.fromkeys(POSITIONS, PLACE)
    | {"time_min": internal(minute=1)}
)
_TEMPERATURE = re.compile(r"T_\w+_degC", re.ASCII)
_MEANT = re.compile(
    r"(?P<start>t(?=[\W_\d])|temp(?:erature?)?(?=[\W_\d]|$))?[\W_]*(?P<sensor>.*?)"
    r"(?P<word>[\W_]*temperatur(?:en?|a)?|[\W_]+temp)?"
    r"(?P<unit>[\W_]*(?:deg[\W_]*[ckf]?|celsius|kelvin|(?<![^\W_])[ckf]))?\W*\Z",
    re.IGNORECASE | re.DOTALL,
)
"""A sensor's name in other programs: `Temp 3 [degC]`, `Spindeltemperatur`, `oil_temp`."""


def is_covariate(name: str) -> bool:
    """Whether a name is a covariate of every machine: dir_x, time_min, T_spindle_degC, ..."""
    return name in COVARIATES or is_temperature(name)


def looks_like_temperature(name: str) -> bool:
    """Whether a name seems to mean a temperature but is none: T_02, t_oil_degC, Temp 3 [degC]."""
    part = _parts(name)
    unit = re.sub(r"[\W_]", "", part["unit"]).casefold()
    # t_min may be a time, and t_c a constant of it.
    began = part["sensor"] and unit if part["start"] == "t" else part["start"]
    degrees = unit in ("degc", "celsius") and part["unit"] != name
    return not is_temperature(name) and bool(began or part["word"] or degrees)


def as_temperature(name: str) -> str | None:
    """The name of a sensor that such a name seems to mean: T_02_degC of T_02; None if unclear, as
    of what is a temperature alone (`T [degC]`).
    """
    sensor = re.sub(r"\W+", "_", _parts(name)["sensor"]).strip("_")
    meant = f"T_{sensor}_degC"
    return meant if is_temperature(meant) else None


def _parts(name: str) -> dict[str, str]:
    return next(_MEANT.finditer(name.replace("\u00b0", "deg"))).groupdict("")


def closest_covariate(name: str, known: Iterable[str]) -> str | None:
    """The known covariate that a name was probably meant to be: of temperatures by their sensors,
    for T_air_degC is no nearer to T_18_degC than air to 18, and T_1_degC is T_01_degC.
    """
    sensors: dict[str, str] = {}
    # What is named as it should be goes before what looks like it.
    for other in sorted(known, key=looks_like_temperature):
        meant = as_temperature(other) if looks_like_temperature(other) else None
        sensors.setdefault(_sensor(meant or other), other)
    sensor = _sensor(name)
    # Numbers that differ are no slip of the fingers.
    near = sensor if sensor.isdigit() else closest(sensor, sensors)
    return None if near is None else sensors.get(near)


def _sensor(name: str) -> str:
    """What tells a temperature from others; any other name is its own."""
    sensor = name.casefold().removeprefix("t_").removesuffix("_degc")
    return re.sub("(?<![0-9])0+(?=[0-9])", "", sensor)


def is_temperature(name: str) -> bool:
    """Whether a name is that of a sensor's temperature: T_spindle_degC, ..."""
    return _TEMPERATURE.fullmatch(name) is not None


def no_temperature(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where no sensor of a machine reads such a value, or none is given."""
    low, high = SENSOR_DEGC
    return ~((values >= low) & (values <= high))


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


def column_dimensions(name: str) -> Powers | None:
    """Those of a position or a column of the contract; None for a user's own column, whatever its
    name ends with: the parameter of an effect has its unit for each step of it.
    """
    return TEMPERATURE if is_temperature(name) else _DIMENSIONS.get(name)


def own_columns(names: Iterable[str], taken: Collection[str]) -> dict[str, Powers]:
    """Of the names of an equation the known ones of columns; `taken` are other things."""
    known = {name: column_dimensions(name) for name in names if name not in taken}
    return {name: dimensions for name, dimensions in known.items() if dimensions is not None}
