"""The noise of temperature readings against drawn readings and finite differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from thermal_machines import IDS, POINTS, angle, line, machine

from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import predict

U = {"T_a_degC": 0.1, "T_b_degC": 0.2, "T_c_degC": 0.05}
EACH = {
    "T_a_degC": np.array([20.0, 21.0, 23.5, 26.0]),
    "T_b_degC": np.array([20.0, 19.0, 24.0, 22.0]),
    "T_c_degC": np.array([18.0, 20.0, 20.5, 25.0]),
}


def noisy(folder: Path) -> MachineModel:
    """T_b moves both px and yaw, so that both are wrong together where it is."""
    return machine(folder, line(sensor_u=(0.1, 0.2)), angle(sensor_u=(0.2, 0.05)))


@pytest.mark.parametrize("row", [[0, 1, 1, 3], [0, 1, 2, 3], [1, 1, 1, 1]])
def test_rows_with_the_same_temperatures_share_one_reading(tmp_path: Path, row: list[int]) -> None:
    """The errors are linear in the temperatures: a step of u for each reading that is another."""
    model, quiet = noisy(tmp_path), machine(tmp_path, line(), angle())
    at = {name: values[row] for name, values in EACH.items()}
    found = predict(model, IDS, POINTS, dict(at)).covariance
    found -= predict(quiet, IDS, POINTS, dict(at)).covariance
    base = predict(quiet, IDS, POINTS, dict(at)).mean
    expected = np.zeros((8, 8))
    for name, u in U.items():
        for reading in set(row):
            moved = at[name] + u * (np.array(row) == reading)
            step = predict(quiet, IDS, POINTS, at | {name: moved}).mean - base
            expected += np.outer(step, step)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-15)
