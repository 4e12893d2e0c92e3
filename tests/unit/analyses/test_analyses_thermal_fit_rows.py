"""thermal-fit and its rows: their order, blocks of them, too many of them, cells that are empty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_drift import REFERENCE, Plan, readings, reordered

from mtu_cli.analyses.thermal_fit import series, thermal_fit
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.errors import InputError
from mtu_cli.files.readings import Readings

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
    assert second.estimate.coefficients == pytest.approx(first.estimate.coefficients, rel=1e-6)
    assert second.estimate.covariance == pytest.approx(first.estimate.covariance, rel=1e-6)
    assert second.estimate.leftover == pytest.approx(first.estimate.leftover, rel=1e-6, abs=1e-14)
    assert first.held_out is not None
    assert second.held_out is not None
    assert second.held_out.after == pytest.approx(first.held_out.after, rel=1e-6)
    assert second.residuals.lag1 == pytest.approx(first.residuals.lag1, rel=1e-6)


def test_blocks_of_readings_are_one_table() -> None:
    """Only the products of neighbours over a border are lost."""
    plan = Plan(gradients=LINE, positions=PLACES, n=40)
    found = plan.read(np.random.default_rng(15))
    parts = [reordered(found, rows) for rows in np.array_split(np.arange(len(found)), 7)]
    together = thermal_fit(parts, {"p": ("x", "um")}, reference=REFERENCE, method="ridge")
    whole, split = one(found), together.components["p"]
    assert split.estimate.coefficients == pytest.approx(whole.estimate.coefficients, rel=1e-8)
    assert split.rms_after == pytest.approx(whole.rms_after, rel=1e-9)
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
        assert drift.estimate.coefficients == pytest.approx(whole.estimate.coefficients, rel=1e-8)
        assert drift.rms_after == pytest.approx(whole.rms_after, rel=1e-9)


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
    assert second.coefficients == pytest.approx(first.coefficients, rel=1e-12)
    assert second.sensor_u == pytest.approx(first.sensor_u, rel=1e-12)
    assert (second.sensor_u > 0).all()


def test_temperatures_that_are_missing() -> None:
    plan = Plan(gradients=LINE[:1], n=20)
    found = plan.read(np.random.default_rng(19))
    found.covariates["T_02_degC"][5] = np.nan
    with pytest.raises(InputError) as raised:
        fitted(found)
    (problem,) = raised.value.problems
    assert (problem.row, problem.column) == (7, "T_02_degC")
    with pytest.raises(InputError, match="no column holds temperatures"):
        fitted(replace(found, covariates={"room": np.zeros(len(found))}))
