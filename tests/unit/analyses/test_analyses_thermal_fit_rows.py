"""thermal-fit and its rows: their order, blocks of them, too many of them, cells that are empty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drift import REFERENCE, ROUNDING, UM, Plan, Run, readings, reordered

from mtu_cli.analyses.thermal_fit import series, thermal_fit
from mtu_cli.analyses.thermal_fit.models import Spec, fit, library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.files.covariates import SENSOR_DEGC
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError
from mtu_cli.stats.lag import first_order_lag

METHODS = ("auto", "stepwise", "ridge", "lagged")
LINE = np.array([[1.0, -2.0, 0.0, 0.5], [1.5, -1.0, 0.0, 0.5], [2.0, 0.0, 0.0, 0.5]])
PLACES = (0.0, 100.0, 200.0)


def fitted(found: Readings, method: str = "ridge") -> ThermalFit:
    return thermal_fit([found], {"p": ("x", "um")}, reference=REFERENCE, method=method)


def one(found: Readings, method: str = "ridge") -> ComponentDrift:
    return fitted(found, method).components["p"]


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


def test_blocks_of_readings_are_one_table() -> None:
    """Only the products of neighbours over a border are lost: seven of them, of n residuals."""
    plan = Plan(gradients=LINE, positions=PLACES, n=40)
    found = plan.read(np.random.default_rng(15))
    parts = [reordered(found, rows) for rows in np.array_split(np.arange(len(found)), 7)]
    together = thermal_fit(parts, {"p": ("x", "um")}, reference=REFERENCE, method="ridge")
    whole, split = one(found), together.components["p"]
    assert split.estimate.coefficients == pytest.approx(whole.estimate.coefficients, rel=ROUNDING)
    assert split.rms_after == pytest.approx(whole.rms_after, rel=ROUNDING)
    assert split.residuals.lag1 == pytest.approx(whole.residuals.lag1, abs=7 / len(found))


def test_blocks_in_which_positions_take_turns() -> None:
    """First blocks of as many rows a position as there are columns, and of fewer."""
    plan = Plan(gradients=LINE, positions=PLACES, n=40)
    found = plan.read(np.random.default_rng(15))
    found = reordered(found, np.argsort(found.time_min, kind="stable"))
    whole = one(found)
    for first in (9, 18, 21):
        parts = np.split(np.arange(len(found)), [first, 150, 300])
        blocks = [reordered(found, rows) for rows in parts]
        split = thermal_fit(blocks, {"p": ("x", "um")}, reference=REFERENCE, method="ridge")
        drift = split.components["p"]
        assert drift.estimate.coefficients == pytest.approx(
            whole.estimate.coefficients, rel=ROUNDING
        )
        assert drift.rms_after == pytest.approx(whole.rms_after, rel=ROUNDING)


def test_more_rows_than_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A component that comes late is fitted as well, its noise of sensors known."""
    plan = Plan(gradients=LINE[:1], positions=(None,), sensor_noise=0.02)
    runs = plan.runs(np.random.default_rng(16))
    late = [replace(run, name="q") for run in runs]
    monkeypatch.setattr(series, "MOST_KEPT", 100)
    machine = {"p": (None, "um"), "q": (None, "um")}
    blocks = [readings(runs), replace(readings(late), components=("q",))]
    found = thermal_fit(blocks, machine, reference=REFERENCE, method="ridge")
    first, second = found.components["p"].estimate, found.components["q"].estimate
    assert second.coefficients == pytest.approx(first.coefficients, rel=ROUNDING)
    assert second.sensor_u == pytest.approx(first.sensor_u, rel=ROUNDING)
    assert (second.sensor_u > 0).all()


def test_temperatures_that_are_missing() -> None:
    plan = Plan(gradients=LINE[:1], n=20)
    found = plan.read(np.random.default_rng(19))
    found.covariates["T_02_degC"][5] = np.nan
    with pytest.raises(InputError) as raised:
        fitted(found)
    (problem,) = raised.value.findings
    assert (problem.row, problem.column) == (7, "T_02_degC")
    with pytest.raises(InputError, match="column 'T_<sensor>_degC': the column is missing"):
        fitted(replace(found, covariates={"room": np.zeros(len(found))}))


def test_columns_that_are_no_sensors_are_told() -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(19))
    assert fitted(found).not_used == ()
    more = {"load": np.zeros(len(found)), "operator": np.full(len(found), "a", object)}
    again = fitted(replace(found, covariates=more | found.covariates))
    assert again.not_used == ("load", "operator")
    assert set(again.sensors) == set(found.covariates)


@pytest.mark.parametrize("value", [1010.0, -1010.0, np.inf, -np.inf])
def test_temperatures_that_no_sensor_reads(value: float) -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(19))
    found.covariates["T_02_degC"][[5, 9]] = value
    with pytest.raises(InputError) as raised:
        fitted(found)
    found_at = [(p.row, p.column, p.value) for p in raised.value.findings]
    assert found_at == [(7, "T_02_degC", f"{value:g}"), (11, "T_02_degC", f"{value:g}")]


@pytest.mark.parametrize("value", SENSOR_DEGC)
def test_the_bound_is_that_of_temperatures_not_of_rises(value: float) -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(19))
    found.covariates["T_02_degC"][5] = value
    low, high = one(found).estimate.temperature_range[1]  # type: ignore[index]  # fitted: known
    assert value in (low, high)


def test_selections_are_those_of_each_cycle_and_position_alone() -> None:
    """What was selected once is kept: it must not be taken for other rows."""
    found = Plan(gradients=LINE, positions=PLACES, n=60).read(np.random.default_rng(23))
    own, sensors = series.read_series([found], REFERENCE)
    lib = library(own["p"], sensors, REFERENCE, lagged=False)
    spec = Spec(kind="stepwise", degree=1, lags=(0,) * len(lib.groups))
    subsets = [(0, 1), (1, 2), (0, 1, 2), (1, 0), (0,)]
    first = [fit(lib, lib.rows(cycles), spec).coefficients for cycles in subsets]
    for cycles, coefficients in zip(subsets, first, strict=True):
        fresh = library(own["p"], sensors, REFERENCE, lagged=False)
        alone = fit(fresh, fresh.rows(cycles), spec).coefficients
        assert coefficients == pytest.approx(alone, rel=ROUNDING, abs=ROUNDING * UM)
    assert not np.allclose(first[0], first[1], rtol=ROUNDING)


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


def test_rows_in_another_order_than_their_times() -> None:
    found = grown("p")
    order = np.random.default_rng(30).permutation(len(found))
    a, b = one(found, "auto"), one(reordered(found, order), "auto")
    assert b.estimate.coefficients == pytest.approx(a.estimate.coefficients, rel=ROUNDING)
    assert b.estimate.leftover == pytest.approx(a.estimate.leftover, rel=ROUNDING)
    assert b.residuals.lag1 == pytest.approx(a.residuals.lag1, rel=ROUNDING)
    assert (b.model, b.estimate.time_constants.tolist()) == ("lagged", [32.0])
    # Without lags their autocorrelation needs the order of time all the same.
    a, b = one(found, "stepwise"), one(reordered(found, order), "stepwise")
    assert b.residuals.lag1 == pytest.approx(a.residuals.lag1, rel=ROUNDING)
    # Independent residuals would have one of 0 with the standard error 1/sqrt(n).
    assert a.residuals.lag1 > 5 / np.sqrt(a.n)


def test_several_readings_of_one_moment() -> None:
    """They are one sample of the temperature, not the start of a new run."""
    drift = one(grown("p", 2), "lagged")
    assert drift.estimate.time_constants == pytest.approx([32.0], rel=ROUNDING)
    # The standard error of a standard deviation of n is its 1/sqrt(2 n).
    assert drift.rms_after / UM == pytest.approx(0.1, rel=5 / np.sqrt(2 * drift.n))


def test_without_a_machine_the_unit_is_that_of_the_readings() -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(31))
    for dimension, unit in ((1, "um"), (0, "arcsec")):
        of_kind = replace(found, dimension=np.full(len(found), dimension, np.int8))
        own = thermal_fit([of_kind], None, reference=REFERENCE, method="ridge")
        assert own.components["p"].unit.name == unit
        assert own.components["p"].estimate.unit.name == unit


def test_readings_of_two_kinds_in_one_component() -> None:
    """Blocks that are sound on their own may contradict each other."""
    first = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(31))
    angle = replace(first, dimension=np.zeros(len(first), np.int8))
    placed = replace(first, position_mm=np.zeros(len(first)))
    for other, column in ((angle, "unit"), (placed, "position_mm")):
        with pytest.raises(InputError) as raised:
            thermal_fit([first, other], None, reference=REFERENCE, method="ridge")
        (problem,) = raised.value.findings
        assert (problem.file, problem.row, problem.column) == ("d.csv", 2, column)


def test_lags_asked_for_with_one_cycle() -> None:
    plan = Plan(gradients=LINE[:1], cycles=1)
    found = fitted(plan.read(np.random.default_rng(32)), "lagged")
    assert found.components["p"].model == "ridge"
    (warned,) = [item for item in found.warnings if item.code == "no-effect-of-temperature"]
    assert "lags are chosen on held-out cycles, and there is one" in warned.message


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


def test_cycles_of_one_name_in_two_files() -> None:
    found = Plan(gradients=LINE[:1]).read(np.random.default_rng(34))
    two = replace(
        found,
        file_index=np.arange(len(found)) % 2,
        sources=(found.sources[0], replace(found.sources[0], shown="e.csv")),
        roles=("drift", "drift"),
    )
    (warned,) = [w for w in fitted(two).warnings if w.code == "order-of-cycles"]
    assert "p: cycle 'c0' is in d.csv and e.csv" in warned.message
    assert "order-of-cycles" not in [w.code for w in fitted(found).warnings]
