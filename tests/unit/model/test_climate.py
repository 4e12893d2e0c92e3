"""Settled rooms: what the sensors of a machine show once everything has its temperature."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.model.simulate_drift import Climate, Sensors, settled

CLIMATE = Climate(
    reference=20.0, low=18.0, high=26.0, room_lag=60.0, room_wobble=0.2, sensor_lag=(5.0, 50.0),
    sensor_spread=0.1, sensor_wobble=0.1, sensor_noise=0.01,
)  # fmt: skip
SENSORS = Sensors(names=("a", "b"), lags=np.array([5.0, 50.0]), shares=np.array([0.9, 1.1]))
ROOMS = np.array([20.0, 30.0, 15.0])


def test_each_sensor_takes_its_share_of_the_rise() -> None:
    found = settled(CLIMATE, SENSORS, ROOMS, 0.0, seed=1)
    assert found == pytest.approx(np.array([[20.0, 20.0], [29.0, 31.0], [15.5, 14.5]]), rel=1e-14)
    assert settled(CLIMATE, SENSORS, ROOMS[:0], 0.0, seed=1).shape == (0, 2)


def test_draughts_are_of_the_stated_size_and_each_sensors_own() -> None:
    """400 draws: the deviation to 4.5 of its standard errors, no correlation beyond as many."""
    rooms = np.full(400, 24.0)
    draughts = settled(CLIMATE, SENSORS, rooms, 0.3, seed=2) - settled(
        CLIMATE, SENSORS, rooms, 0.0, seed=2
    )
    assert (np.abs(draughts.std(axis=0) / 0.3 - 1) < 4.5 / np.sqrt(800)).all()
    together = float((draughts[:, 0] * draughts[:, 1]).mean()) / 0.3**2
    assert abs(together) < 4.5 / np.sqrt(400)
