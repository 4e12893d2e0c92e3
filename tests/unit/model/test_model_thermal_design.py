"""Thermal models as terms of a machine: the design matrix, lags, and what goes without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from thermal_machines import IDS, POINTS, SENSORS, angle, drift, line, machine

from mtu_cli.findings import InputError
from mtu_cli.model.machine_model import design, drift_terms, sensors_of, temperatures, theta
from mtu_cli.model.prediction import predict
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray

UM, ARCSEC = 1e-3, np.pi / 648000
AT = {"T_a_degC": 23.0, "T_b_degC": 19.0, "T_c_degC": 26.5}
EACH = {
    "T_a_degC": np.array([20.0, 21.0, 23.5, 26.0]),
    "T_b_degC": np.array([20.0, 19.0, 24.0, 22.0]),
    "T_c_degC": np.array([18.0, 20.0, 20.5, 25.0]),
}


def by_hand(at: dict[str, FloatArray]) -> FloatArray:
    """Ex, Ey of the machine, its components drifting, written out."""
    x, y = POINTS[:, 0], POINTS[:, 1]
    a, b, c = (at[name] - 20 for name in SENSORS)
    px = (1.0 + 0.02 * x + (1.5 + 0.01 * x) * a + (-0.8 + 0.004 * x) * b) * UM
    py = (-2.0 + 0.01 * y + 1e-5 * y**2) * UM
    yaw = (0.5 + 0.01 * y + 2.0 * b - 1.0 * c) * ARCSEC
    ort = 3.0 * ARCSEC
    return np.column_stack([px + y * yaw - y * ort, py - x * yaw + 0.5 * px]).ravel()


@pytest.mark.parametrize("at", [AT, EACH], ids=["one room", "a room a point"])
def test_predictions_are_the_equations_with_drifting_components(
    tmp_path: Path, at: dict[str, FloatArray | float]
) -> None:
    model = machine(tmp_path, line(), angle())
    expected = by_hand({name: np.broadcast_to(value, 4) for name, value in at.items()})
    found = predict(model, IDS, POINTS, at)
    assert found.mean == pytest.approx(expected, rel=1e-12)
    rows = design(model, POINTS, at)
    assert rows.J @ theta(model) + rows.remainder == pytest.approx(expected, rel=1e-12)


def test_covariance_of_coefficients_and_leftover(tmp_path: Path) -> None:
    """G C G' of the drift's own rows, written out for px, with lever arms 1 and 0.5."""
    rng = np.random.default_rng(51)
    A, B = rng.normal(size=(4, 4)) * 1e-2, rng.normal(size=(2, 2)) * [[0.1], [1e-3]]
    own = line(covariance=A @ A.T, leftover=B @ B.T)
    at = {name: EACH[name] for name in SENSORS}
    more = predict(machine(tmp_path, own), IDS, POINTS, at).covariance
    without = predict(machine(tmp_path), IDS, POINTS).covariance
    x, u = POINTS[:, 0], np.column_stack([EACH[name] - 20 for name in SENSORS[:2]])
    g = np.column_stack([u, x[:, None] * u])
    powers = np.column_stack([np.ones(4), x])
    of_px = (g @ A @ A.T @ g.T + powers @ B @ B.T @ powers.T) * UM**2
    expected = np.kron(of_px, np.outer([1.0, 0.5], [1.0, 0.5]))
    assert more - without == pytest.approx(expected, rel=1e-9, abs=1e-18)


def test_missing_sensors_are_named_with_their_component(tmp_path: Path) -> None:
    model = machine(tmp_path, line(), angle())
    assert set(SENSORS) <= set(model.covariates())
    assert sensors_of(model)["T_b_degC"] == ("px", "yaw")
    with pytest.raises(InputError) as raised:
        predict(model, IDS, POINTS, {"T_a_degC": 21.0})
    assert [problem.facts["names"] for problem in raised.value.findings] == [
        ["T_b_degC"], ["T_c_degC"]
    ]  # fmt: skip


def test_a_thermal_model_without_sensors_leaves_its_leftover(tmp_path: Path) -> None:
    """No sensor explains the drift: its scatter is all that is known of it."""
    own = drift("px", "x", (), np.zeros((1, 0)), leftover=np.array([[0.25]]))
    found = predict(machine(tmp_path, own), IDS, POINTS)
    cold = predict(machine(tmp_path), IDS, POINTS)
    assert (found.mean == cold.mean).all()
    more = found.covariance - cold.covariance
    one = np.outer([1.0, 0.5], [1.0, 0.5]) * 0.25 * UM**2
    assert more == pytest.approx(np.tile(one, (4, 4)), rel=1e-9)


LAGGED = line(time_constants=(30.0, 0.0))


def test_lags_follow_the_times_of_the_rows() -> None:
    """In any order of the rows, with rows of one moment counted once."""
    rng = np.random.default_rng(52)
    time = np.sort(rng.uniform(0.0, 200.0, 25))
    a, b = 20 + rng.normal(size=(2, 25)).cumsum(axis=1)
    expected = first_order_lag(a[:, None], time, np.array([30.0]))[0, :, 0]
    order = rng.permutation(np.repeat(np.arange(25), 2))
    at = {"T_a_degC": a[order], "T_b_degC": b[order], "time_min": time[order]}
    found = temperatures(LAGGED, at, 50)
    assert found[:, 0] == pytest.approx(expected[order], rel=1e-12)
    assert (found[:, 1] == b[order]).all()
    place = {"x": np.linspace(0.0, 100.0, 50)}
    rows = drift_terms(LAGGED, {})[0].columns(place, at, 50)
    rise = np.column_stack([expected[order], b[order]]) - 20
    assert rows[:, :2] == pytest.approx(rise, rel=1e-10)
    assert rows[:, 2:] == pytest.approx(place["x"][:, None] * rise, rel=1e-10, abs=1e-12)


def test_without_times_all_temperatures_count_as_settled() -> None:
    a, b = np.linspace(20.0, 26.0, 6), np.full(6, 21.0)
    untimed: dict[str, FloatArray | float] = {"T_a_degC": a, "T_b_degC": b}
    for at in (untimed, untimed | {"T_b_degC": 21.0, "time_min": 5.0}):
        found = temperatures(LAGGED, at, 6)
        assert found == pytest.approx(np.column_stack([a, b]), rel=1e-15)
    one = temperatures(LAGGED, {"T_a_degC": 24.0, "T_b_degC": 21.0, "time_min": np.arange(6.0)}, 6)
    assert one == pytest.approx(np.tile([24.0, 21.0], (6, 1)), rel=1e-14)
