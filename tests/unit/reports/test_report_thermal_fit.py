"""What thermal-fit reports: names and units of the contract, nulls, tables."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from thermal_examples import (
    CYCLES,
    constant,
    cubic,
    example,
    without_sensors,
)

from mtu_cli.analyses.thermal_fit.result import (
    ComponentDrift,
)
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.reports.thermal_fit import document
from mtu_cli.units import UNITS

CONTRACT = {
    "model", "positions_mm", "sensors", "groups", "coefficients", "r2_fit", "rms_before_um",
    "rms_after_um", "held_out", "collinearity", "residuals", "of", "unit", "degree",
    "reference_temperature_degC", "time_constants_min", "covariance", "coefficient_dof",
    "leftover_covariance", "leftover_dof", "sensor_u_degC", "temperature_range_degC",
    "position_range_mm", "position_test", "at_positions",
}  # fmt: skip


def written(*components: ComponentDrift) -> dict[str, Any]:
    """The components of the report as a reader of the file finds them."""
    text = json.dumps(document(example(*components)).record(), allow_nan=False)
    found: dict[str, Any] = json.loads(text)["components"]
    return found


def names(value: object) -> set[str]:
    """Every key of a document."""
    if isinstance(value, dict):
        return set(value).union(*(names(item) for item in value.values()))
    return set().union(*(names(item) for item in value)) if isinstance(value, list) else set()


def read_back(entry: dict[str, Any]) -> ThermalEstimate:
    """The thermal model of a report, by the words of its description."""
    unit = UNITS[entry["unit"]]
    f = unit.to_internal
    return ThermalEstimate(
        component="", of=entry["of"], unit=unit, sensors=tuple(entry["sensors"]),
        reference=entry["reference_temperature_degC"],
        coefficients=np.array(entry["coefficients"]) * f,
        covariance=np.array(entry["covariance"]) * f**2,
        coefficient_dof=np.inf if entry["coefficient_dof"] is None else entry["coefficient_dof"],
        leftover=np.array(entry["leftover_covariance"]) * f**2,
        leftover_dof=np.inf if entry["leftover_dof"] is None else entry["leftover_dof"],
        time_constants=np.array(entry["time_constants_min"]),
        sensor_u=np.array(entry["sensor_u_degC"]),
    )  # fmt: skip


def test_names_and_units() -> None:
    found = written()
    entry = found["pos_y"]
    assert set(entry) >= CONTRACT
    assert set(found["yaw_y"]) >= {name.replace("_um", "_arcsec") for name in CONTRACT}
    assert not any("arcsec" in name for name in names(entry))
    assert not any("_um" in name for name in names(found["yaw_y"]))
    assert entry["rms_before_um"] == pytest.approx(31.2)
    held = entry["held_out"]
    assert (held["by"], held["rms_before_um"]) == ("cycle", pytest.approx(30.9))
    assert (held["rms_after_um"], held["ordinary_um"]) == pytest.approx((0.31, 0.54))
    assert held["blocks"] == len(CYCLES)
    assert entry["position_test"] == {"F": 812.4, "p": 1e-40}
    assert found["yaw_y"]["at_positions"][0]["gradients_arcsec_per_degC"]["T_01_degC"] == (
        pytest.approx(2.81)
    )


@pytest.mark.parametrize("build", [cubic, constant])
def test_report_holds_the_whole_model(build: Any) -> None:
    known = build().estimate
    again = read_back(written(build())[known.component])
    place = np.array([0.0, 40.0, 310.0])
    T = {name: 20.0 + np.array([1.0, -2.0, 6.0]) * (s + 1) for s, name in enumerate(known.sensors)}
    np.testing.assert_allclose(again.drift(place, T), known.drift(place, T), rtol=1e-12)
    for name in ("covariance", "leftover", "time_constants", "sensor_u"):
        np.testing.assert_allclose(getattr(again, name), getattr(known, name), rtol=1e-12)
    assert (again.coefficient_dof, again.leftover_dof) == (
        known.coefficient_dof,
        known.leftover_dof,
    )
    assert (again.of, again.reference) == (known.of, known.reference)


def test_what_cannot_be_had_is_null() -> None:
    entry = written()["roll_x"]
    assert entry["held_out"] is None
    assert entry["position_test"] is None
    assert entry["positions_mm"] == []
    assert entry["temperature_range_degC"] is None
    assert entry["coefficient_dof"] is None
    assert entry["residuals"]["normality_p"] is None
    odd = replace(cubic(), condition=np.inf, r2_fit=np.nan)
    entry = written(odd)["pos_y"]
    assert (entry["collinearity"]["condition_number"], entry["r2_fit"]) == (None, None)
    assert entry["collinearity"]["vif"]["T_room_degC"] is None
    assert written(without_sensors())["still"]["coefficients"] == [[]]
