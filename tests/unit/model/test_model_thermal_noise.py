"""The noise of temperature readings against drawn readings and finite differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from thermal_machines import IDS, POINTS, SENSORS, angle, line, machine

from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray

U = {"T_a_degC": 0.1, "T_b_degC": 0.2, "T_c_degC": 0.05}
EACH = {
    "T_a_degC": np.array([20.0, 21.0, 23.5, 26.0]),
    "T_b_degC": np.array([20.0, 19.0, 24.0, 22.0]),
    "T_c_degC": np.array([18.0, 20.0, 20.5, 25.0]),
}


def noisy(folder: Path) -> MachineModel:
    """T_b moves both px and yaw, so that both are wrong together where it is."""
    return machine(folder, line(sensor_u=(0.1, 0.2)), angle(sensor_u=(0.2, 0.05)))


def added(model: MachineModel, at: dict[str, FloatArray | float], folder: Path) -> FloatArray:
    """What the noise adds to the covariance of a prediction."""
    quiet = machine(folder, line(), angle())
    return predict(model, IDS, POINTS, at).covariance - predict(quiet, IDS, POINTS, at).covariance


def check(found: FloatArray, draws: FloatArray) -> None:
    """A covariance against that of draws, within five standard errors of each element."""
    seen = draws.T @ draws / len(draws)
    size = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    error = np.sqrt((found**2 + size**2) / len(draws))
    assert (np.abs(seen - found) <= 5 * error + 1e-20).all()


def lagged(covariates: dict[str, FloatArray], taus: dict[str, float]) -> dict[str, FloatArray]:
    """First-order lags by a loop, in the order of time."""
    order = np.argsort(covariates["time_min"], kind="stable")
    found = {}
    for name, tau in taus.items():
        T, t = covariates[name][order], covariates["time_min"][order]
        u = T.copy()
        for i in range(1, len(t)):
            g = (T[i] - T[i - 1]) * tau / (t[i] - t[i - 1])
            u[i] = T[i] - g + (u[i - 1] - T[i - 1] + g) * np.exp(-(t[i] - t[i - 1]) / tau)
        found[name] = np.empty_like(u)
        found[name][order] = u
    return found


@pytest.mark.parametrize("time", [
    [1000.0, 0.0, 1005.0, 5.0], [0.0, 2.0, 4.0, 6.0], [0.0, 500.0, 1000.0, 1500.0]
])  # fmt: skip
def test_noise_comes_through_a_lag_as_drawn_histories_have_it(
    tmp_path: Path, time: list[float]
) -> None:
    """Uneven steps, a cold start, and steps far longer than the lag: all but independent."""
    tau = {"T_a_degC": 60.0, "T_b_degC": 15.0}
    drifts = (line(time_constants=tuple(tau.values()), sensor_u=(0.1, 0.2)),
              angle(time_constants=(15.0, 0.0), sensor_u=(0.2, 0.05)))  # fmt: skip
    at = EACH | {"time_min": np.array(time)}
    found = added(machine(tmp_path, *drifts), dict(at), tmp_path)
    rng = np.random.default_rng(57)
    # The machine without lags is given the lagged readings.
    settled = machine(tmp_path, line(), angle())
    base = predict(settled, IDS, POINTS, lagged(at, tau) | {"T_c_degC": at["T_c_degC"]}).mean
    draws = np.zeros((400, 8))
    for k in range(len(draws)):
        noisy = {name: at[name] + U[name] * rng.normal(size=4) for name in SENSORS}
        seen = lagged(at | noisy, tau) | {"T_c_degC": noisy["T_c_degC"]}
        draws[k] = predict(settled, IDS, POINTS, seen).mean - base
    check(found, draws)


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
