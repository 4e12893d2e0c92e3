"""Drifts of components from the machine file and from a thermal-fit report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import loaded

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.reports_read import ThermalReport, read_report
from mtu_cli.findings import InputError
from mtu_cli.model.fit import thermal_from_machine_file, thermal_from_report

POSITIONS = [0.0, 200.0, 75.0, 300.0]
MACHINE = """
    components:
      pos_y:
        of: y
        unit: um
        thermal:
          positions_mm: [0, 200, 75, 300]
          gradients: {T_01_degC: [-3.5, 0, 0.5, 4.02], T_02_degC: [19.6, 12.3, 11.7, 5.03]}
          time_constants_min: {T_02_degC: 40}
          s_leftover: 0.3
          sensor_u_degC: {T_01_degC: 0.015}
      yaw_y: {of: y, unit: arcsec, thermal: {gradients: {T_03_degC: 2}}}
      ort: {unit: arcsec, coefficients: [3]}
    equations: {Ex: pos_y + y*yaw_y - y*ort}
"""


def lagrange(positions: list[float], values: list[float], p: float) -> float:
    """The interpolating polynomial, without powers."""
    total = 0.0
    for i, value in enumerate(values):
        others = [x for j, x in enumerate(positions) if j != i]
        total += value * float(np.prod([(p - x) / (positions[i] - x) for x in others]))
    return total


def test_a_drift_of_the_machine_file_goes_through_its_positions(tmp_path: Path) -> None:
    found = thermal_from_machine_file(loaded(tmp_path, MACHINE))
    assert set(found) == {"pos_y", "yaw_y"}
    drift = found["pos_y"]
    assert (drift.component, drift.of, drift.unit.name, drift.degree) == ("pos_y", "y", "um", 3)
    assert drift.sensors == ("T_01_degC", "T_02_degC")
    assert (drift.reference, drift.position_range) == (20.0, (0.0, 300.0))
    # 1 um per degC and 1e-3 mm: the tolerance is that of double numbers at mm.
    for p in (0.0, 75.0, 120.0, 200.0, 300.0, 350.0):
        expected = 6 * lagrange(POSITIONS, [-3.5, 0, 0.5, 4.02], p)
        expected -= 2 * lagrange(POSITIONS, [19.6, 12.3, 11.7, 5.03], p)
        rises = {"T_01_degC": np.array([26.0]), "T_02_degC": np.array([18.0])}
        assert drift.drift(np.array([p]), rises) == pytest.approx([expected * 1e-3], abs=1e-12)
    assert not drift.covariance.any()
    assert drift.covariance.shape == (8, 8)
    assert (drift.coefficient_dof, drift.leftover_dof) == (np.inf, np.inf)
    wanted = np.zeros((4, 4))
    wanted[0, 0] = 0.3e-3**2
    np.testing.assert_allclose(drift.leftover, wanted, rtol=1e-14)
    assert drift.time_constants.tolist() == [0, 40]
    assert drift.sensor_u.tolist() == [0.015, 0]
    assert drift.temperature_range is None


DRIFT: dict[str, Any] = {
    "of": "y", "unit": "um", "degree": 1, "sensors": ["T_a_degC", "T_b_degC"],
    "reference_temperature_degC": 20, "time_constants_min": [0, 40],
    "coefficients": [[1.5, 2], [3, 4]],
    "covariance": [[1, 0.5, 0, 0], [0.5, 2, 0, 0], [0, 0, 3, 0], [0, 0, 0, 4]],
    "coefficient_dof": None, "leftover_covariance": [[0.25, 0], [0, 1e-6]], "leftover_dof": 12.5,
    "sensor_u_degC": [0.01, 0.02], "temperature_range_degC": [[19, 26], [20, 25]],
    "position_range_mm": [0, 200],
}  # fmt: skip


def report(tmp_path: Path, **components: dict[str, Any]) -> ThermalReport:
    path = tmp_path / "t.json"
    document = {"schema": "mtu/thermal-fit/1", "results": {"components": components}}
    path.write_text(json.dumps(document))
    found = read_report(path)
    assert isinstance(found, ThermalReport)
    return found


@pytest.fixture
def machine(tmp_path: Path) -> LoadedMachine:
    return loaded(tmp_path, MACHINE)


def test_a_report_wins_over_the_machine_file(tmp_path: Path, machine: LoadedMachine) -> None:
    found = thermal_from_report(machine, report(tmp_path, pos_y=DRIFT))
    assert set(found) == {"pos_y", "yaw_y"}
    stated = thermal_from_machine_file(machine)["yaw_y"]
    assert found["yaw_y"].coefficients.tolist() == stated.coefficients.tolist()
    drift = found["pos_y"]
    assert drift.sensors == ("T_a_degC", "T_b_degC")
    np.testing.assert_allclose(drift.coefficients, [[1.5e-3, 2e-3], [3e-3, 4e-3]], rtol=1e-15)
    np.testing.assert_allclose(drift.covariance, np.array(DRIFT["covariance"]) * 1e-6, rtol=1e-15)
    np.testing.assert_allclose(drift.leftover, [[0.25e-6, 0], [0, 1e-12]], rtol=1e-15)
    assert (drift.coefficient_dof, drift.leftover_dof) == (np.inf, 12.5)
    assert drift.time_constants.tolist() == [0, 40]
    assert drift.sensor_u.tolist() == [0.01, 0.02]
    assert drift.temperature_range is not None
    assert drift.temperature_range.tolist() == [[19, 26], [20, 25]]
    assert (drift.of, drift.position_range, drift.reference) == ("y", (0, 200), 20)


def test_a_report_of_another_machine(tmp_path: Path, machine: LoadedMachine) -> None:
    other = DRIFT | {"of": "x", "reference_temperature_degC": 20.5}
    with pytest.raises(InputError) as caught:
        thermal_from_report(machine, report(tmp_path, pos_z=DRIFT, pos_y=other, yaw_y=DRIFT))
    assert [(item.path, item.code) for item in caught.value.findings] == [
        ("results.components.pos_z", "unknown-name"),
        ("results.components.pos_y.reference_temperature_degC", "contradicts"),
        ("results.components.pos_y", "contradicts"),
        ("results.components.yaw_y", "contradicts"),
    ]
