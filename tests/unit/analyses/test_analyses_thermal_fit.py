"""thermal-fit on planted drifts: gradients, groups, sensors that fail, cycles, order of rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drift import (
    LINE,
    METHODS,
    PLACES,
    REFERENCE,
    ROUNDING,
    UM,
    Plan,
    Run,
    fitted,
    one,
    readings,
    reordered,
    sensor_names,
)

from mtu_cli.analyses.thermal_fit import series, thermal_fit
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray


def gradients(drift: ComponentDrift) -> FloatArray:
    """(positions, s) um per degC, in the order of all sensors."""
    names = sorted({name for own in drift.at_positions for name in own.gradients})
    return np.array([[own.gradients[name] / UM for name in names] for own in drift.at_positions])


def codes(found: ThermalFit) -> list[str]:
    return [warned.code for warned in found.warnings]


@pytest.mark.parametrize("method", METHODS)
def test_noise_free_gradients_come_back(method: str) -> None:
    """To rounding: a held-out error of nothing is lowest without a penalty."""
    plan = Plan(gradients=LINE, positions=PLACES, noise=0.0, n=30)
    drift = one(plan.read(np.random.default_rng(1)), method)
    assert drift.estimate.degree == 1
    none = dict.fromkeys(sensor_names(4), 0.0)
    by_sensor = [none | own.gradients for own in drift.at_positions]
    found = np.array([[row[name] / UM for name in sensor_names(4)] for row in by_sensor])
    assert found == pytest.approx(LINE, abs=ROUNDING)
    assert drift.r2_fit == pytest.approx(1.0, abs=ROUNDING)
    if method == "stepwise":
        assert drift.estimate.sensors == ("T_01_degC", "T_02_degC", "T_04_degC")


def test_coefficients_are_powers_of_the_position_in_mm() -> None:
    """g(p) = a + b p of each sensor, also where the positions are far from 0 and uneven."""
    places = (900.0, 1000.0, 1250.0, 1300.0)
    g = np.array([[2.0 + 0.01 * p, -1.0] for p in places])
    plan = Plan(gradients=g, positions=places, noise=0.0, n=30)
    estimate = one(plan.read(np.random.default_rng(2))).estimate
    assert estimate.coefficients / UM == pytest.approx(
        np.array([[2.0, -1.0], [0.01, 0.0]]), abs=2 * ROUNDING
    )
    at = {"T_01_degC": np.full(2, 23.0), "T_02_degC": np.full(2, 21.0)}
    drift = estimate.drift(np.array([950.0, 1100.0]), at)
    assert drift / UM == pytest.approx([3 * 11.5 - 1, 3 * 13.0 - 1], rel=ROUNDING)
    assert estimate.position_range == (900.0, 1300.0)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_degree_in_position_is_found(degree: int) -> None:
    shape = np.array([1.0, 0.2, -0.4, 0.3])
    p = np.array([0.0, 75.0, 200.0, 300.0])
    g = np.outer((p / 300.0) ** degree if degree else np.ones(4), shape) * 2
    for method in ("stepwise", "ridge"):
        plan = Plan(gradients=g, positions=tuple(p.tolist()), n=40)
        drift = one(plan.read(np.random.default_rng(3)), method)
        assert drift.estimate.degree == degree
        test = drift.position_test
        assert test is not None
        # Without a dependence p is uniform: below 0.001 in one of a thousand data sets.
        assert test.p > 1e-3 if degree == 0 else test.p < 1e-6


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("method", ["stepwise", "ridge"])
def test_twins_are_one_group(method: str, sign: int) -> None:
    """T_03 goes with T_01, or against it: the group's gradient is shared equally."""
    plan = Plan(gradients=np.array([[4.0, 1.0, 0.0]]))
    rng = np.random.default_rng(4)
    runs = plan.runs(rng)
    for run in runs:
        noise = 1e-3 * rng.normal(size=plan.n)
        run.temperature[:, 2] = REFERENCE + sign * (run.temperature[:, 0] - REFERENCE) + noise
    drift = one(readings(runs), method)
    assert drift.groups == (("T_01_degC", "T_03_degC"),)
    values = drift.at_positions[0].gradients
    assert values["T_01_degC"] == pytest.approx(sign * values["T_03_degC"], rel=ROUNDING)
    u = np.sqrt(drift.estimate.covariance[0, 0])
    assert abs(values["T_01_degC"] - 2.0 * UM) < 5 * u
    assert set(drift.vif) == set(drift.estimate.sensors)
    C = drift.estimate.covariance
    at = [drift.estimate.sensors.index(name) for name in ("T_01_degC", "T_03_degC")]
    assert C[at[0], at[1]] == pytest.approx(sign * C[at[0], at[0]], rel=ROUNDING)


def test_a_still_sensor_is_left_out() -> None:
    plan = Plan(gradients=np.array([[2.0, 1.0, 0.0]]))
    runs = plan.runs(np.random.default_rng(6))
    for run in runs:
        run.temperature[:, 1] = 21.3
    found = fitted(readings(runs), "auto")
    assert "T_02_degC" not in found.components["p"].estimate.sensors
    (warned,) = [item for item in found.warnings if item.code == "sensor-still"]
    assert (warned.facts["sensor"], warned.facts["where"]) == ("T_02_degC", " at 21.3 degC")


def test_no_sensor_moves() -> None:
    plan = Plan(gradients=np.array([[2.0, 1.0]]))
    runs = plan.runs(np.random.default_rng(7))
    for run in runs:
        run.temperature[:] = 21.3
    found = fitted(readings(runs), "auto")
    drift = found.components["p"]
    assert drift.estimate.sensors == ()
    assert drift.estimate.coefficients.shape == (1, 0)
    assert drift.rms_after == pytest.approx(drift.rms_before, rel=ROUNDING)
    assert {"no-effect-of-temperature", "sensor-still"} <= set(codes(found))


@pytest.mark.parametrize("positions", [(None,), (0.0, 200.0)])
def test_cycles_that_begin_apart_are_told(positions: tuple[float | None, ...]) -> None:
    """A probe that was set anew: the readings of a cycle count from another zero."""
    plan = Plan(gradients=np.array([[2.0, 1.0, 0.5]] * len(positions)), positions=positions)
    true = plan.temperatures(np.random.default_rng(9))
    for cycle in true:
        cycle -= cycle[0] - 20.0
    runs = plan.runs(np.random.default_rng(9), true)
    free = fitted(readings(runs))
    assert "order-of-cycles" not in codes(free)
    assert not free.components["p"].zeroed.offsets
    for run in runs:
        run.error[:] += 40 * UM * int(str(run.cycle)[1:])
    found = fitted(readings(runs))
    assert "order-of-cycles" in codes(found)
    drift = found.components["p"]
    assert drift.zeroed.offsets
    assert gradients(drift) == pytest.approx(gradients(free.components["p"]), abs=0.1)


@pytest.mark.parametrize("zeroed", ["auto", "cycle"])
def test_a_probe_zeroed_at_the_start_of_every_cycle(zeroed: str) -> None:
    """Its gradients and held-out rms are those of a probe that was zeroed once, the first reading
    of every cycle 0 or not.
    """
    plan = Plan(gradients=np.array([[2.0, 1.0, 0.5]]))
    runs = plan.runs(np.random.default_rng(9))
    free = one(readings(runs))
    for run in runs:
        run.error[:] -= run.error[0] if zeroed == "auto" else 5 * UM
    drift = thermal_fit(
        readings(runs), {"p": (None, "um")}, reference=20.0, method="ridge", zeroed=zeroed
    ).components["p"]
    assert drift.zeroed.by == ("first readings" if zeroed == "auto" else "setting")
    assert gradients(drift) == pytest.approx(gradients(free), abs=0.05)
    assert drift.held_out is not None
    assert free.held_out is not None
    assert drift.held_out.after == pytest.approx(free.held_out.after, rel=0.1)


@pytest.mark.parametrize("labelled", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_one_cycle_takes_its_degree_from_the_test(method: str, labelled: bool) -> None:
    cycle = "c0" if labelled else None
    for g, degree in ((LINE, 2), (np.repeat(LINE[:1], 3, axis=0), 0)):
        plan = Plan(gradients=g, positions=PLACES, cycles=1)
        runs = [replace(run, cycle=cycle) for run in plan.runs(np.random.default_rng(12))]
        found = fitted(readings(runs), method)
        drift = found.components["p"]
        assert drift.held_out is None
        assert drift.cycles == ("c0" if labelled else "",)
        assert "not-held-out" in codes(found)
        assert drift.estimate.degree == degree
        expected = "ridge" if method in ("ridge", "lagged") else "stepwise"
        assert drift.model == expected


def test_the_reference_temperature_only_moves_the_levels() -> None:
    plan = Plan(gradients=LINE, positions=PLACES, n=40)
    found = plan.read(np.random.default_rng(18))
    warm = thermal_fit(found, {"p": ("x", "um")}, reference=23.0, method="ridge")
    a, b = one(found), warm.components["p"]
    assert b.estimate.coefficients == pytest.approx(a.estimate.coefficients, rel=ROUNDING)
    assert b.estimate.covariance == pytest.approx(a.estimate.covariance, rel=ROUNDING)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("places", "fewest"), [((0.0,), 3), ((0.0, 100.0), 4)])
def test_fewest_readings(method: str, places: tuple[float, ...], fewest: int) -> None:
    """A level at each position, one gradient, and one reading more."""
    rng = np.random.default_rng(22)

    def read(n: int) -> Readings:
        return readings(
            [
                Run(
                    time=np.linspace(0.0, 1.0, own),
                    temperature=20 + rng.normal(size=(own, 1)),
                    error=rng.normal(size=own) * UM,
                    position=place,
                )
                for k, place in enumerate(places)
                if (own := n // len(places) + (k < n % len(places)))
            ]
        )

    assert one(read(fewest), method).n == fewest
    with pytest.raises(InputError, match=f"expected at least {fewest}: one more"):
        fitted(read(fewest - 1), method)


# thermal-fit and its rows: their order, blocks of them, too many of them, cells that are empty.


@pytest.mark.parametrize("method", METHODS)
def test_positions_read_in_any_order(method: str) -> None:
    """Position by position, or at every time all positions in an order of their own."""
    plan = Plan(gradients=LINE, positions=PLACES, n=40)
    found = plan.read(np.random.default_rng(13))
    order = np.lexsort((np.random.default_rng(14).uniform(size=len(found)), found.time_min))
    first, second = one(found, method), one(reordered(found, order), method)
    assert second.estimate.coefficients == pytest.approx(first.estimate.coefficients, rel=ROUNDING)
    assert second.estimate.covariance == pytest.approx(first.estimate.covariance, rel=ROUNDING)
    assert second.estimate.leftover == pytest.approx(
        first.estimate.leftover, rel=ROUNDING, abs=1e-20
    )
    assert first.held_out is not None
    assert second.held_out is not None
    assert second.held_out.after == pytest.approx(first.held_out.after, rel=ROUNDING)
    assert second.residuals.lag1 == pytest.approx(first.residuals.lag1, rel=ROUNDING)


def test_more_rows_than_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fifth of each position and cycle, in whatever order the file has them."""
    found = Plan(gradients=LINE, positions=PLACES, n=100).read(np.random.default_rng(16))
    order = np.argsort(found.time_min, kind="stable")
    fifths = reordered(found, np.flatnonzero(np.arange(len(found)) % 5 == 0))
    monkeypatch.setattr(series, "MOST_ROWS", len(found) // 5)
    thinned = fitted(reordered(found, order))
    (warned,) = [item for item in thinned.warnings if item.code == "not-used"]
    assert "of 1200 readings every 5th of a cycle is fitted" in warned.message
    monkeypatch.undo()
    drift, alone = thinned.components["p"], one(fifths)
    assert drift.n == 240
    assert drift.estimate.coefficients == pytest.approx(alone.estimate.coefficients, rel=ROUNDING)
    assert drift.held_out is not None
    assert alone.held_out is not None
    assert drift.held_out.after == pytest.approx(alone.held_out.after, rel=ROUNDING)


def test_numeric_columns_that_are_no_sensors_are_named() -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(19))
    still = np.full(len(found), 20.0)
    more = dict.fromkeys(("T_c_DegC", "t_oil", "speed"), still)
    warnings = fitted(replace(found, covariates=found.covariates | more)).warnings
    (warning,) = (item for item in warnings if item.code == "not-used")
    assert warning.facts["names"] == ["T_c_DegC", "t_oil", "speed"]


def grown(name: str, k: int = 1) -> Readings:
    """A drift that lags, read at three positions, `k` rows for each moment."""
    rng = np.random.default_rng(29)
    plan = Plan(gradients=np.array([[2.0]]), positions=PLACES, n=60, cycles=4)
    runs = []
    for c, T in enumerate(plan.temperatures(rng)):
        time = np.repeat(plan.time(c), k)
        lagged = first_order_lag(T, plan.time(c), np.array([32.0]))[0, :, 0] - REFERENCE
        for position in PLACES:
            clean = np.repeat((1 + position / 100) * 2.0 * lagged, k)
            error = (clean + 0.1 * rng.normal(size=len(clean))) * UM
            runs.append(Run(name=name, position=position, cycle=f"c{c}", time=time,
                            temperature=np.repeat(T, k, axis=0), error=error))  # fmt: skip
    return readings(runs)


def test_the_degree_in_position_of_a_drift_that_lags() -> None:
    """Without its lag a line in position is worth nothing: the lag must be found first."""
    found = grown("p")
    drift = one(found, "lagged")
    assert (drift.model, drift.estimate.degree) == ("lagged", 1)
    assert drift.estimate.time_constants == pytest.approx([32.0], rel=ROUNDING)
    planted, u = np.array([2.0, 0.02]) * UM, np.sqrt(np.diag(drift.estimate.covariance))
    assert (np.abs(drift.estimate.coefficients[:, 0] - planted) < 5 * u).all()
    # The standard error of a standard deviation of n is its 1/sqrt(2 n).
    assert drift.rms_after / UM == pytest.approx(0.1, rel=5 / np.sqrt(2 * drift.n))


@pytest.mark.parametrize("value", [0.0, 3.0, 0.1])
def test_readings_that_do_not_differ(value: float) -> None:
    """No sensor explains rounding, and no figure is made of it."""
    found = Plan(gradients=LINE, positions=PLACES).read(np.random.default_rng(33))
    result = fitted(replace(found, error=np.full(len(found), value * UM)), "auto")
    drift = result.components["p"]
    assert drift.estimate.sensors == ()
    assert np.isnan(drift.r2_fit)
    assert drift.residuals.lag1 == 0
    assert drift.held_out is None
    codes = [item.code for item in result.warnings]
    assert "no-effect-of-temperature" in codes
    assert "no-better" not in codes
