"""thermal-fit and its rows: their order, blocks of them, too many of them, cells that are empty."""

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
)

from mtu_cli.analyses.thermal_fit import series
from mtu_cli.files.readings import Readings
from mtu_cli.stats.lag import first_order_lag


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


def test_columns_that_are_nearly_sensors_are_named() -> None:
    found = Plan(gradients=LINE[:1], n=20).read(np.random.default_rng(19))
    still = np.full(len(found), 20.0)
    more = dict.fromkeys(("T_c_DegC", "t_oil", "speed"), still)
    warnings = fitted(replace(found, covariates=found.covariates | more)).warnings
    (warning,) = (item for item in warnings if item.code == "not-used")
    assert warning.facts["names"] == ["T_c_DegC", "t_oil"]


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
