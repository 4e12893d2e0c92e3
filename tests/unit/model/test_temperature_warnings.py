"""What is said of temperatures that a thermal model has not seen, or that cannot be right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_machines import POINTS, angle, line, machine

from mtu_cli.model.features import outside_warnings
from mtu_cli.model.prediction import predict
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.stats.least_squares import FloatArray

ROOM: dict[str, FloatArray | float] = {"T_a_degC": 23.0, "T_b_degC": 24.0, "T_c_degC": 22.0}
RANGE = np.array([[20.0, 26.0], [20.0, 25.0]])


def test_a_sensor_beyond_the_fit_is_told_once_with_what_it_may_cost(tmp_path: Path) -> None:
    """T_b moves px by (-0.8 + 0.004 x) um/K and yaw by 2 arcsec/K: at c, Ex by 0.2 + 2.9 um/K."""
    model = machine(tmp_path, replace(line(), temperature_range=RANGE),
                    replace(angle(), temperature_range=RANGE))  # fmt: skip
    assert temperature_warnings(model, POINTS, ROOM) == []
    (warned,) = temperature_warnings(model, POINTS, ROOM | {"T_a_degC": 28.0})
    assert warned.code == "outside-measured-range"
    # dEx/dT_a = 1.5 + 0.01 * 250 um/K at most, and 2 K are beyond.
    assert warned.facts["what"] == "T_a_degC at 28 degC (up to 8 um)"
    assert (warned.facts["low"], warned.facts["high"]) == (20, 26)
    found = temperature_warnings(model, POINTS, ROOM | {"T_b_degC": 19.0})
    assert ["px" in w.message for w in found] == [True, False]
    both = machine(tmp_path, replace(line(), temperature_range=RANGE),
                   replace(angle(), temperature_range=RANGE[[1, 1]]))  # fmt: skip
    (one,) = temperature_warnings(both, POINTS, ROOM | {"T_b_degC": 19.0})
    assert one.facts["names"] == ["the drift of px, yaw"]


def test_positions_beyond_the_drift_are_told_without_names_of_terms(tmp_path: Path) -> None:
    model = machine(tmp_path, replace(line(), position_range=(0.0, 200.0)))
    found = predict(model, ("a", "b", "c", "d"), POINTS, ROOM)
    (warned,) = outside_warnings(found)
    assert warned.facts["names"] == ["the drift of px"]
    assert warned.facts["what"].startswith("feature 'c'")


@pytest.mark.parametrize("lag", [0.0, 30.0])
def test_lags_without_a_history(tmp_path: Path, lag: float) -> None:
    model = machine(tmp_path, line(time_constants=(lag, 0.0)))
    codes = [w.code for w in temperature_warnings(model, POINTS, ROOM)]
    assert codes == (["settled-temperatures"] if lag else [])
