"""Covariates that every machine knows by name."""

from __future__ import annotations

import re

COVARIATES = ("dir_x", "dir_y", "dir_z", "time_min", "sequence")
HOTTEST_DEGC = 200.0
"""No sensor of a machine reads more, nor less than minus this; what a shop is in kelvin is more."""
KELVIN = 273.15
COLDEST_K, HOTTEST_K = 230.0, 400.0
"""Values beyond HOTTEST_DEGC that are likely kelvin."""
_TEMPERATURE = re.compile(r"T_\w+_degC", re.ASCII)


def is_covariate(name: str) -> bool:
    """Whether a name is a covariate of every machine: dir_x, time_min, T_spindle_degC, ..."""
    return name in COVARIATES or is_temperature(name)


def looks_like_temperature(name: str) -> bool:
    """Whether a name seems to mean a temperature but is none: t_oil_degC, T_oil-1_degC, ..."""
    folded = name.casefold()
    meant = folded.startswith("t_") and folded.endswith("_degc")
    return meant and not is_temperature(name)


def is_temperature(name: str) -> bool:
    """Whether a name is that of a sensor's temperature: T_spindle_degC, ..."""
    return _TEMPERATURE.fullmatch(name) is not None


def expected_temperature(value: float) -> str:
    """What was expected where `value` is beyond what a sensor of a machine reads."""
    expected = f"degC, at most {HOTTEST_DEGC:g} in size"
    if not COLDEST_K < value < HOTTEST_K:
        return expected
    return f"{expected}: in kelvin it would be {value - KELVIN:.4g} degC"
