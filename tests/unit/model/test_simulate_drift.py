"""Simulated drift tests, settled rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.simulate import (
    WOBBLE_MEMORY_MIN,
    DriftPlan,
    Sensors,
    SimulatedDrift,
    followed,
    sensors_for,
    simulate_drift,
)
from mtu_cli.stats.serial import first_order_lag
from mtu_cli.units import UNITS

STILL = DriftPlan(
    reference=20.0, low=20.0, high=26.0, room_lag=30.0, room_wobble=0.0, sensor_lag=(5.0, 25.0),
    sensor_spread=0.05, sensor_wobble=0.0, sensor_noise=0.0, cycles=3, minutes=30.0, interval=2.0,
    soak=10.0, positions={"p": np.array([0.0, 200.0])}, noise={1: 0.0, 0: 0.0}, settled={},
    limits={1: 1.0, 0: 1.0},
)  # fmt: skip
NOISY = replace(STILL, room_wobble=0.5, sensor_wobble=0.8, sensor_noise=0.015)
A, B = "T_a_degC", "T_b_degC"


def drift(name: str = "p", tau: float = 0.0, leftover: float = 0.0) -> ThermalEstimate:
    """5 um/K of a and 0.01 um/mm/K of b, minus 2 um/K of b, along y."""
    return ThermalEstimate(
        component=name,
        of="y",
        unit=UNITS["um"],
        sensors=(A, B),
        reference=20.0,
        coefficients=np.array([[5e-3, -2e-3], [0.0, 1e-5]]),
        covariance=np.zeros((4, 4)),
        coefficient_dof=np.inf,
        leftover=np.diag([leftover**2, 0.0]),
        leftover_dof=np.inf,
        time_constants=np.array([tau, 0.0]),
        sensor_u=np.zeros(2),
    )


def rises(found: SimulatedDrift, rows: np.ndarray) -> list[np.ndarray]:
    return [found.temperatures[name][rows] - 20 for name in (A, B)]


@pytest.mark.parametrize("tau", [0.0, 40.0])
def test_noise_free_readings_are_the_drift_of_the_temperatures_in_the_file(tau: float) -> None:
    """Of a sensor with a time constant, of the lagged temperature."""
    found = simulate_drift([drift(tau=tau)], replace(NOISY, sensor_noise=0.0, cycles=1), 1)
    for position in (0.0, 200.0):
        rows = found.position == position
        a, b = rises(found, rows)
        lagged = first_order_lag(a[:, None], found.time[rows], np.array([tau]))[0, :, 0]
        expected = 5 * lagged + (-2 + 0.01 * position) * b
        assert found.error[rows] == pytest.approx(expected, abs=1e-9)
        assert (np.abs(5 * (a - lagged)).max() > 1) == (tau > 0)
    assert found.error[0] == 0.0
    assert np.abs(found.error).max() > 1


def test_cycles_are_apart_by_soaking_and_warm_and_cool_in_turn() -> None:
    found = simulate_drift([drift()], replace(STILL, minutes=300.0, soak=60.0), 1)
    share = found.sensors.shares[0]
    for cycle, start, end in ((1, 0, 26.0), (2, 362, 20.0), (3, 724, 26.0)):
        rows = (found.cycle == cycle) & (found.position == 0)
        assert found.time[rows] == pytest.approx(start + 2.0 * np.arange(151))
        last = 20 + share * (end - 20)
        assert found.temperatures[A][rows][-1] == pytest.approx(last, abs=0.01)


def test_moments_of_noise_and_leftover_and_twins() -> None:
    """Twins see the same, read apart, and change nothing else."""
    many = replace(NOISY, sensor_noise=0.02, cycles=400, minutes=8.0, noise={1: 1e-3, 0: 0},
                twins=(("T_c_degC", A),))  # fmt: skip
    exact = replace(many, sensor_noise=0.0, twins=())
    clean = simulate_drift([drift()], replace(exact, noise={1: 0.0, 0: 0.0}), 3)
    found = simulate_drift([drift(leftover=4e-3)], many, 3)
    assert list(found.temperatures) == [A, B, "T_c_degC"]
    n, first = len(found.error) // 2, found.position == 0
    noise = [(found.temperatures[x] - clean.temperatures[A])[first] for x in (A, "T_c_degC")]
    for each in (*noise, (noise[0] - noise[1]) / np.sqrt(2)):
        assert each.std() == pytest.approx(0.02, rel=4.5 / np.sqrt(2 * n))
    rest = (found.error - clean.error).reshape(400, 2, 5)
    # The leftover is one draw for both positions of a cycle.
    state = rest.mean(axis=(1, 2))
    assert state.var(ddof=1) == pytest.approx(16 + 0.1, rel=4.5 * np.sqrt(2 / 399))
    spread = (rest - rest.mean(axis=2, keepdims=True)).reshape(800, 5)
    assert np.sum(spread**2) / 3200 == pytest.approx(1.0, rel=4.5 * np.sqrt(2 / 3200))


def test_draughts_have_the_declared_spread_and_memory() -> None:
    climate = replace(STILL, sensor_wobble=0.8, high=20.0, interval=5.0)
    sensors = Sensors(names=(A,), lags=np.zeros(1), shares=np.ones(1))
    air = followed(climate, sensors, np.full(60_001, 20.0), 4)[1000:, 0] - 20
    q = np.exp(-5 / WOBBLE_MEMORY_MIN)
    independent = len(air) * (1 - q**2) / (1 + q**2)
    assert air.var() == pytest.approx(0.64, rel=4.5 * np.sqrt(2 / independent))
    correlation = np.corrcoef(air[:-1], air[1:])[0, 1]
    assert correlation == pytest.approx(q, abs=4.5 * np.sqrt((1 - q**2) / len(air)))


def test_shares_move_as_little_as_the_settled_drifts_ask_for() -> None:
    drawn = sensors_for([drift()], NOISY, 1).shares
    assert np.abs(drawn - 1).max() <= 0.05
    asked = replace(NOISY, settled={"p": np.array([12e-3, 18e-3])})
    shares = sensors_for([drift()], asked, 1).shares
    # 6 K: 30 a - 12 b at 0 mm and 30 a at 200 mm.
    assert shares == pytest.approx([0.6, 0.5], abs=1e-9)
    # One place, two sensors: the change is along the gradients, which no smaller one can do; so it
    # is where a limit is exceeded.
    one = replace(NOISY, positions={"p": np.array([0.0])})
    six = {"p": np.array([6e-3])}
    for given in (replace(one, settled=six), replace(one, limits={1: 6e-3, 0: 1.0})):
        shares = sensors_for([drift()], given, 1).shares
        assert (shares - drawn)[0] * -2 == pytest.approx((shares - drawn)[1] * 5)
        assert 6 * (5 * shares[0] - 2 * shares[1]) == pytest.approx(6)


def test_drifts_that_the_sensors_cannot_give() -> None:
    impossible = replace(
        NOISY, positions={"p": np.array([0.0, 0.0])}, settled={"p": np.array([12e-3, 18e-3])}
    )
    with pytest.raises(InputError) as told:
        sensors_for([drift()], impossible, 1)
    # The nearest to both is halfway between.
    assert "about 15 15 um" in str(told.value)
