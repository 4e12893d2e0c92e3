"""A thermal model in three states: against the sum over sensors and powers, written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtu_cli.model.simulate_drift import STEPS, drift_profile
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.units import UNITS

RANGES = np.array([[19.0, 25.0], [20.0, 22.0]])
ESTIMATE = ThermalEstimate(
    component="a", of="x", unit=UNITS["um"], sensors=("T_a_degC", "T_b_degC"), reference=20.0,
    coefficients=np.array([[2.0, -1.0], [0.01, 0.02]]), covariance=np.zeros((4, 4)),
    coefficient_dof=np.inf, leftover=np.zeros((2, 2)), leftover_dof=np.inf,
    time_constants=np.zeros(2), sensor_u=np.zeros(2), temperature_range=RANGES,
    position_range=(0.0, 300.0),
)  # fmt: skip


def summed(estimate: ThermalEstimate, place: float, state: np.ndarray) -> float:
    return sum(
        float(estimate.coefficients[m, s]) * place**m * (float(state[s]) - 20.0)
        for m in range(len(estimate.coefficients))
        for s in range(2)
    )


def test_coldest_half_way_and_warmest_along_the_axis() -> None:
    observed = (0.0, 100.0, 300.0)
    found = drift_profile(ESTIMATE, observed)
    assert found.ranged
    assert found.temperatures.tolist() == [[19.0, 20.0], [22.0, 21.0], [25.0, 22.0]]
    assert (found.places[0], found.places[-1]) == (0.0, 300.0)
    for k, state in enumerate(found.temperatures):
        for places, drift in ((found.places, found.drift), (np.array(observed), found.at_observed)):
            wanted = [summed(ESTIMATE, place, state) for place in places.tolist()]
            # Doubles of 40 um round by 7e-15 um.
            assert drift[k] == pytest.approx(wanted, abs=1e-13)


def test_without_a_range_all_sensors_rise_alike() -> None:
    found = drift_profile(replace(ESTIMATE, temperature_range=None), (0.0, 300.0))
    assert not found.ranged
    assert found.temperatures.tolist() == [[20.0 + step] * 2 for step in STEPS]


def test_a_drift_that_is_the_same_everywhere_has_one_place() -> None:
    constant = replace(ESTIMATE, coefficients=ESTIMATE.coefficients[:1])
    assert drift_profile(constant, (0.0, 300.0)).drift.shape == (3, 1)
    assert drift_profile(ESTIMATE, (100.0,)).drift.shape == (3, 1)
    without = replace(
        constant, sensors=(), coefficients=np.zeros((1, 0)), temperature_range=np.zeros((0, 2))
    )
    assert drift_profile(without, ()).drift.tolist() == [[0.0]] * 3
