"""The noise of temperature readings against drawn readings and finite differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from thermal_machines import IDS, POINTS, SENSORS, angle, line, machine

from mtu_cli.model.design import design
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.temperature_noise import temperature_blocks, temperature_gradients
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray

U = {"T_a_degC": 0.1, "T_b_degC": 0.2, "T_c_degC": 0.05}
ROOM = {"T_a_degC": 23.0, "T_b_degC": 19.0, "T_c_degC": 26.5}
EACH = {
    "T_a_degC": np.array([20.0, 21.0, 23.5, 26.0]),
    "T_b_degC": np.array([20.0, 19.0, 24.0, 22.0]),
    "T_c_degC": np.array([18.0, 20.0, 20.5, 25.0]),
}
AT: tuple[dict[str, FloatArray | float], ...] = (dict(ROOM), dict(EACH))
DRAWS = 20_000


def noisy(folder: Path) -> MachineModel:
    """T_b moves both px and yaw, so that both are wrong together where it is."""
    return machine(folder, line(sensor_u=(0.1, 0.2)), angle(sensor_u=(0.2, 0.05)))


def added(model: MachineModel, at: dict[str, FloatArray | float], folder: Path) -> FloatArray:
    """What the noise adds to the covariance of a prediction."""
    quiet = machine(folder, line(), angle())
    return predict(model, IDS, POINTS, at).covariance - predict(quiet, IDS, POINTS, at).covariance


def drawn(model: MachineModel, at: dict[str, FloatArray | float], *, shared: bool) -> FloatArray:
    """Errors (draws, rows) with noise on the readings; linear, so that differences draw them."""
    rng = np.random.default_rng(53)
    base = predict(model, IDS, POINTS, at).mean
    total = np.zeros((DRAWS, len(base)))
    for name in SENSORS:
        if shared:
            step = predict(model, IDS, POINTS, {**at, name: np.add(at[name], 1.0)}).mean - base
            total += np.outer(rng.normal(size=DRAWS) * U[name], step)
            continue
        for i in range(len(POINTS)):
            moved = np.array(np.broadcast_to(at[name], len(POINTS)))
            moved[i] += 1.0
            step = predict(model, IDS, POINTS, {**at, name: moved}).mean - base
            total += np.outer(rng.normal(size=DRAWS) * U[name], step)
    return total


def check(found: FloatArray, draws: FloatArray) -> None:
    """A covariance against that of draws, within five standard errors of each element."""
    seen = draws.T @ draws / len(draws)
    size = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    error = np.sqrt((found**2 + size**2) / len(draws))
    assert (np.abs(seen - found) <= 5 * error + 1e-20).all()


def test_one_reading_for_all_points(tmp_path: Path) -> None:
    model = noisy(tmp_path)
    found = added(model, dict(ROOM), tmp_path)
    check(found, drawn(model, dict(ROOM), shared=True))
    # All points are wrong together: lengths hardly notice what points do.
    assert abs(found[2, 4]) > 0.1 * np.sqrt(found[2, 2] * found[4, 4])


def test_a_reading_for_each_point(tmp_path: Path) -> None:
    model = noisy(tmp_path)
    found = added(model, dict(EACH), tmp_path)
    check(found, drawn(model, dict(EACH), shared=False))
    for i in range(4):
        for j in range(4):
            if i != j:
                assert np.abs(found[2 * i : 2 * i + 2, 2 * j : 2 * j + 2]).max() < 1e-20


def test_components_that_use_one_sensor_are_wrong_together(tmp_path: Path) -> None:
    """At (x, y): dEx/dT_b = px' + y yaw', dEy/dT_b = px'/2 - x yaw', squared and multiplied."""
    x, y = POINTS[2, 0], POINTS[2, 1]
    slope, turn = (-0.8 + 0.004 * x) * 1e-3, 2.0 * np.pi / 648000
    of_b = np.array([slope + y * turn, 0.5 * slope - x * turn])
    of_a = (1.5 + 0.01 * x) * 1e-3 * np.array([1.0, 0.5])
    of_c = -np.pi / 648000 * np.array([y, -x])
    expected = sum(
        (
            U[name] ** 2 * np.outer(g, g)
            for name, g in zip(SENSORS, (of_a, of_b, of_c), strict=True)
        ),
        np.zeros((2, 2)),
    )
    for found in (added(noisy(tmp_path), at, tmp_path) for at in AT):
        assert found[4:6, 4:6] == pytest.approx(expected, rel=1e-9)


def test_gradients_are_finite_differences(tmp_path: Path) -> None:
    model = noisy(tmp_path)
    rows = design(model, POINTS, EACH)
    found = temperature_gradients(model, POINTS, rows.levers)
    assert set(found) == set(SENSORS)
    for name in SENSORS:
        moved = {**EACH, name: EACH[name] + 1.0}
        step = predict(model, IDS, POINTS, moved).mean - predict(model, IDS, POINTS, EACH).mean
        assert found[name] == pytest.approx(step, rel=1e-9, abs=1e-15)


def test_one_block_a_sensor_with_noise(tmp_path: Path) -> None:
    model = machine(tmp_path, line(sensor_u=(0.1, 0.0)), angle())
    rows = design(model, POINTS, EACH)
    blocks = temperature_blocks(model, POINTS, EACH, rows.levers)
    assert [block.names for block in blocks] == [("T_a_degC",)]
    cold = machine(tmp_path)
    assert temperature_blocks(cold, POINTS, {}, design(cold, POINTS, {}).levers) == []


def measurand(found: Prediction) -> float:
    """Variance of the difference of the errors in x at the second and the third point."""
    A = np.zeros((1, 8))
    A[0, 2], A[0, 4] = -1.0, 1.0
    return float(found.variance(A).total[0])


@pytest.mark.parametrize("at", [ROOM, EACH], ids=["one room", "a room a point"])
def test_variance_of_a_length_is_that_of_its_covariance(
    tmp_path: Path, at: dict[str, FloatArray | float]
) -> None:
    found = predict(noisy(tmp_path), IDS, POINTS, at)
    C = found.covariance
    assert measurand(found) == pytest.approx(C[2, 2] + C[4, 4] - 2 * C[2, 4], rel=1e-9)


def test_a_lag_averages_the_noise_of_readings(tmp_path: Path) -> None:
    """Readings dt apart, tau = 40 dt: sqrt(dt/(2 tau)) of the noise is left, by drawn histories.

    A lag that is linear between readings keeps 1 part in 2 (tau/dt)^2 less: nothing here.
    """
    n, dt, tau, u = 400, 0.5, 20.0, 0.3
    time = dt * np.arange(n, dtype=np.float64)
    draws = first_order_lag(np.random.default_rng(54).normal(size=(n, 4000)) * u, time,
                            np.array([tau]))[0, -1]  # fmt: skip
    left = np.sqrt(dt / (2 * tau))
    assert draws.std() == pytest.approx(u * left, rel=5 / np.sqrt(2 * 4000) + 1e-3)
    model = machine(tmp_path, line(time_constants=(tau, 0.0), sensor_u=(u, 0.0)))
    plain = machine(tmp_path, line(sensor_u=(u, 0.0)))
    points = np.tile(POINTS[1], (n, 1))
    at = {"T_a_degC": 20 + 0.01 * time, "T_b_degC": np.full(n, 21.0), "time_min": time}
    variances = []
    for item in (model, plain):
        rows = design(item, points, at)
        (block,) = temperature_blocks(item, points, at, rows.levers)
        assert not block.G.any()
        variances.append(block.noise[:, 0] ** 2)
    assert variances[0] == pytest.approx(variances[1] * left**2, rel=1e-9)
    steep = machine(tmp_path, line(time_constants=(0.1, 0.0), sensor_u=(u, 0.0)))
    (block,) = temperature_blocks(steep, points, at, design(steep, points, at).levers)
    # A lag shorter than the step averages nothing.
    assert block.noise[:, 0] ** 2 == pytest.approx(variances[1], rel=1e-12)
