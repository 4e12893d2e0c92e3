"""Which covariate was meant: temperatures are told apart by their sensors alone."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.files.covariates import (
    as_temperature,
    closest_covariate,
    looks_like_temperature,
    no_temperature,
)


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("T_1_degC", ["T_01_degC", "T_10_degC"], "T_01_degC"),
        ("T_17_degC", ["T_18_degC", "T_7_degC"], None),
        ("T_spindel_degC", ["T_room_degC", "T_spindle_degC"], "T_spindle_degC"),
        ("time", ["time_min", "dir_x"], "time_min"),
        ("load", ["T_load_degC"], "T_load_degC"),
        # Sensors by names of other programs, after those by their own.
        ("T_spindle_degC", ["load", "Temperatur Spindel"], "Temperatur Spindel"),
        ("T_1_degC", ["T_1", "T_01_degC"], "T_01_degC"),
        ("T_spindle_degC", ["Temperatur [\u00b0C]"], None),
    ],
)
def test_the_covariate_that_was_meant(name: str, known: list[str], meant: str | None) -> None:
    assert closest_covariate(name, known) == meant


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("Lufttemperatur", "T_Luft_degC"),
        ("spindle temperature", "T_spindle_degC"),
        ("Spindeltemperatur [\u00b0C]", "T_Spindel_degC"),
        ("oil_temp", "T_oil_degC"),
        ("K\u00fchlmitteltemperatur", None),
        ("temperature", None),
    ],
)
def test_what_ends_in_temperature_is_one(name: str, meant: str | None) -> None:
    assert looks_like_temperature(name)
    assert as_temperature(name) == meant


@pytest.mark.parametrize("name", ["attempt", "contemp", "tempo", "temperament"])
def test_what_only_has_some_of_its_letters_is_none(name: str) -> None:
    assert not looks_like_temperature(name)


def test_temperatures_have_one_limit() -> None:
    """That of --at, of drift readings and of the checks."""
    values = np.array([-60.1, -60.0, 20.0, 150.0, 150.1, np.nan])
    assert no_temperature(values).tolist() == [True, False, False, False, True, True]
