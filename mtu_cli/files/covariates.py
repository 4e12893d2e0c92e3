"""Covariates: their names, cells, directions and temperatures, and what each is measured in."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

from mtu_cli.findings import closest
from mtu_cli.units import Powers, internal

DIRECTIONS = ("dir_x", "dir_y", "dir_z")
COVARIATES = (*DIRECTIONS, "time_min", "sequence")
SIGN_WORDS = {"forward": 1, "+": 1, "1": 1, "+1": 1, "reverse": -1, "-": -1, "-1": -1}
SIGN_EXPECTED = "forward or reverse, + or -, 1 or -1"
TEMPERATURE_EXPECTED = "a number in degC: leave out the column, or the rows"
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-"})
"""What a word processor makes of a minus: as a sign it can mean nothing else."""
STEADY_K = 0.05
"""Range of a temperature that does not change: a thermometer reads as much from itself."""
NEAR_K = 0.5
"""Temperatures this near to one another are one to a shop: a meter of steel grows by 6 um."""
HOTTEST_DEGC = 200.0
"""No sensor of a machine reads more, nor less than minus this; what a shop is in kelvin is more."""
KELVIN = 273.15
COLDEST_K, HOTTEST_K = 230.0, 400.0
"""Values beyond HOTTEST_DEGC that are likely kelvin."""
_TEMPERATURE = re.compile(r"T_\w+_degC", re.ASCII)
_START = re.compile(r"^(?:temp(?:erature?)?(?=$|[\W_\d])|t(?=[\W_\d]))[\W_]*", re.IGNORECASE)
_ENDING = re.compile(r"[\W_]*(?:deg[\W_]*[ckf]?|celsius|kelvin|(?<=[\W_])[ckf])\W*$", re.IGNORECASE)
_WORD = re.compile(r"[\W_]*temperatur(?:en?|a)?$|[\W_]+temp$", re.IGNORECASE)
"""Behind what it is of: `Spindeltemperatur`, `spindle temperature`, `oil_temp`."""
_LEADING_ZEROS = re.compile("(?<![0-9])0+(?=[0-9])")
_MEANT = re.compile(
    # What begins as a temperature does, and what is given in degC; t_min may be a time.
    r"^T[\W_\d]|^(?i:temp(?:erature?)?)(?:$|[\W_\d])"
    r"|(?i:[\W_]deg[\W_]?c|[\W_]celsius|^t[\W_\d]\w*[\W_]c|temperatur(?:en?|a)?|[\W_]temp)\W*$"
)


def is_covariate(name: str) -> bool:
    """Whether a name is a covariate of every machine: dir_x, time_min, T_spindle_degC, ..."""
    return name in COVARIATES or is_temperature(name)


def is_steady(name: str, span: float) -> bool:
    """Whether values whose range is `span` do not change, but for what a sensor reads."""
    # A range of printed values is rounded: 26.05 - 26.
    return span <= (STEADY_K + 1e-9 if is_temperature(name) else 0.0)


def looks_like_temperature(name: str) -> bool:
    """Whether a name seems to mean a temperature but is none: T_02, t_oil_degC, Temp 3 [degC]."""
    folded = name.replace("\u00b0", "deg")
    return _MEANT.search(folded) is not None and not is_temperature(name)


def as_temperature(name: str) -> str | None:
    """The name of a sensor that such a name seems to mean: T_02_degC of T_02; None if unclear, as
    of what is a temperature alone (`T [degC]`).
    """
    found = f"T_{_core(name)}_degC"
    return None if is_bare(name) or not is_temperature(found) else found


def is_bare(name: str) -> bool:
    """Whether nothing but temperature and unit is left of a name: `Temperatur [degC]`."""
    return _core(name) in ("", "t", "T")


def _core(name: str) -> str:
    core = _ENDING.sub("", name.replace("\u00b0", "deg"))
    core = re.sub(r"\W+", "_", _START.sub("", core)).strip("_")
    return _WORD.sub("", core).strip("_")


def closest_covariate(name: str, known: Iterable[str]) -> str | None:
    """The known covariate that a name was probably meant to be: of temperatures by their sensors,
    for T_air_degC is no nearer to T_18_degC than air to 18, and T_1_degC is T_01_degC.
    """
    sensors: dict[str, str] = {}
    # What is named as it should be goes before what looks like it.
    for other in sorted(known, key=looks_like_temperature):
        meant = as_temperature(other) if looks_like_temperature(other) else None
        sensors.setdefault(_sensor(meant or other), other)
    own = _sensor(name)
    # Numbers that differ are no slip of the fingers.
    near = (own if own in sensors else None) if own.isdigit() else closest(own, sensors)
    return None if near is None else sensors[near]


def _sensor(name: str) -> str:
    """What tells a temperature from others; any other name is its own."""
    return _LEADING_ZEROS.sub("", name.casefold().removeprefix("t_").removesuffix("_degc"))


def is_temperature(name: str) -> bool:
    """Whether a name is that of a sensor's temperature: T_spindle_degC, ..."""
    return _TEMPERATURE.fullmatch(name) is not None


def like_kelvin(value: float) -> bool:
    """Whether what is no temperature of a machine in degC likely is one in kelvin."""
    return COLDEST_K < value < HOTTEST_K


def expected_temperature(value: float) -> str:
    """What was expected where `value` is beyond what a sensor of a machine reads."""
    expected = f"degC, at most {HOTTEST_DEGC:g} in size"
    if not like_kelvin(value):
        return expected
    return f"{expected}: in kelvin it would be {value - KELVIN:.4g} degC"


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


POSITIONS = ("x", "y", "z")


NUMBER = internal()
PLACE = internal(length=1)
TEMPERATURE = internal(degree=1)
TIME = internal(minute=1)
_KNOWN = {"dir_x": NUMBER, "dir_y": NUMBER, "dir_z": NUMBER, "sequence": NUMBER,
          "time_min": TIME} | dict.fromkeys(POSITIONS, PLACE)  # fmt: skip


def column_dimensions(name: str) -> Powers | None:
    """Those of a position or a column of the contract; None for a user's own column, whatever its
    name ends with: the parameter of an effect has its unit for each step of it.
    """
    return TEMPERATURE if is_temperature(name) else _KNOWN.get(name)


def own_columns(names: Iterable[str], taken: Collection[str]) -> dict[str, Powers]:
    """Of the names of an equation the known ones of columns; `taken` are other things."""
    found = {name: column_dimensions(name) for name in names if name not in taken}
    return {name: own for name, own in found.items() if own is not None}
