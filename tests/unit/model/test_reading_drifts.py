"""Known thermal drift taken out of readings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from model_examples import estimate, readings
from numpy.typing import NDArray
from reading_examples import in_table_order, machine, only, run
from thermal_machines import drift

from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.files.readings import Readings
from mtu_cli.model.estimates import Estimates
from mtu_cli.units import UM

Floats = NDArray[np.float64]


def with_temperature(found: Readings, values: Floats | None = None) -> Readings:
    T = np.asarray(20 + 0.2 * np.arange(len(found)) if values is None else values, np.float64)
    return replace(found, covariates={"T_a_degC": T})


def test_known_drift_goes_where_its_temperatures_are(tmp_path: Path) -> None:
    known = drift("px", "x", ("T_a_degC",), np.array([[1.5], [0.01]]))
    estimates = Estimates(
        components={"px": estimate("px", "x", [0.0, 1e-4])}, thermal={"px": known}
    )
    found = with_temperature(readings([run(3)]))
    table = only(reading_tables(machine(tmp_path), estimates, found))
    rise = found.covariates["T_a_degC"].astype(float) - 20
    left = found.error - 1e-4 * found.position_mm - UM * (1.5 + 0.01 * found.position_mm) * rise
    order = in_table_order(found)
    np.testing.assert_allclose(table.errors.ravel(), left[order], atol=1e-15)
    assert table.covariates["T_a_degC"].shape == (3, 8)
    for bare in (readings([run(3)]), with_temperature(found, np.full(24, np.nan))):
        (table,), warned = reading_tables(machine(tmp_path), estimates, bare)
        assert [item.code for item in warned] == ["drift-not-removed"]
        np.testing.assert_allclose(
            table.errors.ravel(), (bare.error - 1e-4 * bare.position_mm)[order], atol=1e-15
        )
    # Of the drift alone something is known: the line of the rest is the readings' own.
    alone = only(reading_tables(machine(tmp_path), replace(estimates, components={}), found))
    assert alone.fitted_degree == 1
    X = np.column_stack([np.ones(24), found.position_mm])
    rest = found.error - UM * (1.5 + 0.01 * found.position_mm) * rise
    rest -= X @ np.linalg.lstsq(X, rest, rcond=None)[0]
    np.testing.assert_allclose(alone.errors.ravel(), rest[order], atol=1e-14)


def test_lags_follow_the_readings_times(tmp_path: Path) -> None:
    slow = drift("px", "x", ("T_a_degC",), np.array([[1.5]]), time_constants=(7.0,))
    estimates = Estimates(components={"px": estimate("px", "x", [0, 0])}, thermal={"px": slow})
    found = with_temperature(readings([run(3)]))
    table = only(reading_tables(machine(tmp_path), estimates, found))
    # A ramp of 0.2 degC a minute from rest: T - 20 - g tau (1 - exp(-t/tau)).
    t = found.time_min
    rise = 0.2 * t - 0.2 * 7 * (1 - np.exp(-t / 7))
    order = in_table_order(found)
    np.testing.assert_allclose(
        table.errors.ravel(), (found.error - 1.5 * UM * rise)[order], atol=1e-14
    )
