"""thermal-fit on planted drifts: gradients, groups, sensors that fail, cycles, order of rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_tables import made_readings
from synthetic_drift import (
    LINE,
    METHODS,
    PLACES,
    REFERENCE,
    ROUNDING,
    UM,
    Plan,
    fitted,
    one,
    reordered,
    sensor_names,
)

from mtu_cli.analyses.thermal_fit import ComponentDrift, ThermalFit, design, thermal_fit
from mtu_cli.findings import InputError
from mtu_cli.stats.least_squares import FloatArray

PLAIN = Plan(gradients=np.array([[2.0, 1.0, 0.5]]))


def gradients(drift: ComponentDrift, sensors: int) -> FloatArray:
    """(positions, sensors) um per degC; 0 of one that the model does not use."""
    by_place = {(x.position, x.sensors[0]): x.value / UM for x in drift.gradients}
    names, places = sensor_names(sensors), drift.positions or (None,)
    return np.array([[by_place.get((p, name), 0.0) for name in names] for p in places])


def codes(found: ThermalFit) -> list[str]:
    return [warned.code for warned in found.warnings]


@pytest.mark.parametrize("method", METHODS)
def test_noise_free_gradients_come_back(method: str) -> None:
    """To rounding: a held-out error of nothing is lowest without a penalty."""
    plan = Plan(gradients=LINE, positions=PLACES, noise=0.0, n=30)
    drift = one(plan.read(np.random.default_rng(1)), method)
    assert drift.estimate.degree == 1
    assert gradients(drift, 4) == pytest.approx(LINE, abs=ROUNDING)
    assert drift.r2_fit == pytest.approx(1.0, abs=ROUNDING)
    if method == "stepwise":
        assert drift.estimate.sensors == ("T_01_degC", "T_02_degC", "T_04_degC")


def test_coefficients_are_powers_of_the_position_in_mm() -> None:
    """g(p) = a + b p of each sensor, also where the positions are far from 0 and uneven; the
    reference temperature only moves the levels.
    """
    places = (900.0, 1000.0, 1250.0, 1300.0)
    g = np.array([[2.0 + 0.01 * p, -1.0] for p in places])
    plan = Plan(gradients=g, positions=places, noise=0.0, n=30)
    found = plan.read(np.random.default_rng(2))
    estimate = one(found).estimate
    expected = np.array([[2.0, -1.0], [0.01, 0.0]])
    assert estimate.coefficients / UM == pytest.approx(expected, abs=2 * ROUNDING)
    at = {"T_01_degC": np.full(2, 23.0), "T_02_degC": np.full(2, 21.0)}
    drift = estimate.drift(np.array([950.0, 1100.0]), at)
    assert drift / UM == pytest.approx([3 * 11.5 - 1, 3 * 13.0 - 1], rel=ROUNDING)
    assert estimate.position_range == (900.0, 1300.0)
    warm = thermal_fit(found, {"p": ("x", "um")}, reference=23.0, method="ridge").components["p"]
    assert warm.estimate.coefficients / UM == pytest.approx(expected, abs=2 * ROUNDING)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("method", ["stepwise", "ridge"])
def test_twins_are_one_group(method: str, sign: int) -> None:
    """T_03 goes with T_01, or against it: the group's gradient is shared equally."""
    plan, rng = Plan(gradients=np.array([[4.0, 1.0, 0.0]])), np.random.default_rng(4)
    T = plan.temperatures(rng)
    T[..., 2] = REFERENCE + sign * (T[..., 0] - REFERENCE) + 1e-3 * rng.normal(size=T.shape[:2])
    drift = one(plan.read(rng, T), method)
    assert drift.groups == (("T_01_degC", "T_03_degC"),)
    ((first, _, third),) = gradients(drift, 3)
    assert first == pytest.approx(sign * third, rel=ROUNDING)
    C = drift.estimate.covariance
    assert abs(first - 2.0) < 5 * np.sqrt(C[0, 0]) / UM
    assert set(drift.vif) == set(drift.estimate.sensors)
    i, j = (drift.estimate.sensors.index(name) for name in drift.groups[0])
    assert C[i, j] == pytest.approx(sign * C[i, i], rel=ROUNDING)
    assert [x.sensors for x in drift.inseparable] == list(drift.groups)


def test_still_sensors_and_readings() -> None:
    """What does not move is left out, and no figure is made of the rounding of readings."""
    rng = np.random.default_rng(6)
    T = PLAIN.temperatures(rng)
    T[..., 1] = 21.3
    found = fitted(PLAIN.read(rng, T), "auto")
    assert "T_02_degC" not in found.components["p"].estimate.sensors
    (warned,) = [item for item in found.warnings if item.code == "sensor-still"]
    assert (warned.facts["sensor"], warned.facts["where"]) == ("T_02_degC", " at 21.3 degC")
    same = PLAIN.read(rng, np.full_like(T, 21.3))
    read = PLAIN.read(rng)
    for given in (same, *(replace(read, error=np.full(len(read), x * UM)) for x in (0, 3, 0.1))):
        found = fitted(given, "auto")
        drift = found.components["p"]
        assert drift.estimate.coefficients.shape == (1, 0)
        assert drift.rms_after == pytest.approx(drift.rms_before, rel=ROUNDING)
        assert np.isnan(drift.r2_fit) == (given is not same)
        assert drift.held_out is None
        assert "no-effect-of-temperature" in codes(found)
        assert "no-better" not in codes(found)


@pytest.mark.parametrize("positions", [(np.nan,), (0.0, 200.0)])
@pytest.mark.parametrize("how", ["test", "first readings", "setting"])
def test_a_probe_that_is_zeroed_in_every_cycle(positions: tuple[float, ...], how: str) -> None:
    """Its gradients and held-out rms are those of a probe that was zeroed once."""
    g = PLAIN.gradients * np.array([[1.0], [1.1]])[: len(positions)]
    plan, rng = replace(PLAIN, gradients=g, positions=positions), np.random.default_rng(9)
    T = plan.temperatures(rng)
    T -= T[:, :1] - 20.0
    found = plan.read(rng, T)
    free = fitted(found)
    assert "order-of-cycles" not in codes(free)
    code = len(positions) * found.cycle + (found.position_mm > 0)
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    off = {"test": -40 * UM * found.cycle, "setting": np.full(len(found), 5 * UM)}
    moved = replace(found, error=found.error - off.get(how, found.error[first][which]))
    result = fitted(moved, zeroed="cycle" if how == "setting" else "auto")
    drift, other = result.components["p"], free.components["p"]
    assert (drift.offsets, drift.by, other.offsets) == (True, how, False)
    assert ("order-of-cycles" in codes(result)) == (how != "setting")
    assert gradients(drift, 3) == pytest.approx(gradients(other, 3), abs=0.1)
    assert drift.held_out is not None
    assert other.held_out is not None
    assert drift.held_out.after == pytest.approx(other.held_out.after, rel=0.1)


@pytest.mark.parametrize("places", [(0.0,), (0.0, 100.0)])
def test_fewest_readings(places: tuple[float, ...]) -> None:
    """A level and a gradient at each position, and one reading more."""
    rng, n = np.random.default_rng(22), 2 * len(places) + 1
    found = made_readings(
        rng.normal(size=n) * UM, ("p",), position=np.resize(places, n), time=np.arange(n),
        role="drift", covariates={"T_01_degC": 20 + rng.normal(size=n)},
    )  # fmt: skip
    assert one(found).n == n
    with pytest.raises(InputError, match=f"expected {n} for the "):
        fitted(reordered(found, np.arange(n - 1)))


def test_more_rows_than_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fifth of each position and cycle, in whatever order the file has them."""
    found = Plan(gradients=LINE, positions=PLACES, n=100).read(np.random.default_rng(16))
    order = np.argsort(found.time_min, kind="stable")
    fifths = reordered(found, np.flatnonzero(np.arange(len(found)) % 5 == 0))
    monkeypatch.setattr(design, "MOST_ROWS", len(found) // 5)
    thinned = fitted(reordered(found, order))
    (warned,) = [item for item in thinned.warnings if item.code == "not-used"]
    assert "of 1200 readings every 5th of a cycle is fitted" in warned.message
    monkeypatch.undo()
    drift, alone = thinned.components["p"], one(fifths)
    assert drift.n == 240
    assert drift.estimate.coefficients == pytest.approx(alone.estimate.coefficients, rel=ROUNDING)
    assert drift.held_out == pytest.approx(alone.held_out, rel=ROUNDING)


def test_columns_that_are_no_sensors_or_not_in_every_file() -> None:
    found = PLAIN.read(np.random.default_rng(19))
    more = dict.fromkeys(("T_c_DegC", "t_oil", "speed"), np.full(len(found), 20.0))
    warnings = fitted(replace(found, covariates=found.covariates | more)).warnings
    (warning,) = (item for item in warnings if item.code == "not-used")
    assert warning.facts["names"] == ["T_c_DegC", "t_oil", "speed"]
    with pytest.raises(InputError, match="columns such as T_01_degC"):
        fitted(replace(found, covariates=more))
    gap = {"T_09_degC": np.where(found.cycle == 1, np.nan, 20.0)}
    with pytest.raises(InputError, match=r"T_09_degC.*the column in every file, or in none"):
        fitted(replace(found, covariates=found.covariates | gap))
