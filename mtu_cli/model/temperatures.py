"""What the temperatures of a prediction add: noise of the sensors, and what to warn of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.basis import TIME, Covariates, ThermalBasis, row_times
from mtu_cli.model.design import design, places
from mtu_cli.model.machine_model import MachineModel, sensors_of
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.model.variance import Block
from mtu_cli.stats.lag import lag_of_moments
from mtu_cli.stats.least_squares import FloatArray


def temperature_gradients(
    model: MachineModel,
    points: FloatArray,
    levers: FloatArray,
    share: dict[str, dict[str, float]] | None = None,
) -> dict[str, FloatArray]:
    """dE/dT_s (rows,) in mm per degC of every sensor: lever sum_m g[m, s] p^m over all drifts.

    `points` (n, 3), `levers` (rows, terms) as `design` gives them. `share` (component, sensor)
    multiplies the part of one drift.
    """
    place, n = places(model, points), len(points)
    found: dict[str, FloatArray] = {}
    for t, drift in _drifts(model):
        position = np.zeros(n) if drift.of is None else place[drift.of]
        gradients = np.polynomial.polynomial.polyval(position, drift.coefficients)
        for s, sensor in enumerate(drift.sensors):
            factor = 1.0 if share is None else share[drift.component][sensor]
            own = levers[:, t] * np.repeat(gradients[s] * factor, len(levers) // n)
            found[sensor] = found.get(sensor, np.zeros(len(levers))) + own
    return found


def noise_columns(
    model: MachineModel, points: FloatArray, levers: FloatArray
) -> dict[str, FloatArray]:
    """dE/dT_s u(T_s) (rows,) in mm of every sensor: what one standard uncertainty of a reading
    does to the errors at `points` (n, 3) once they have settled.
    """
    share = {
        drift.component: dict(zip(drift.sensors, drift.sensor_u.tolist(), strict=True))
        for _, drift in _drifts(model)
    }
    return temperature_gradients(model, points, levers, share)


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[Block]:
    """What the noise of the temperature readings adds to the errors at `points` (n, 3).

    Rows with the same temperatures share one reading, and its error; other readings are
    independent. A lag is linear in the readings, u = L T: with times, the noise of earlier
    readings comes through it as they do, and rows near in time are wrong together. With R
    (n, K) the readings of the rows, sensor s of noise u_s adds F F', F = diag(dE/dT_s) u_s L R.
    """
    n, a = len(points), len(levers) // max(len(points), 1)
    readings = _readings(model, covariates, n)
    columns: dict[str, dict[float, FloatArray]] = {}
    for t, drift in _drifts(model):
        one = replace(model, terms=(model.terms[t],))
        for sensor, column in noise_columns(one, points, levers[:, [t]]).items():
            tau = float(drift.time_constants[drift.sensors.index(sensor)])
            by_lag = columns.setdefault(sensor, {})
            by_lag[tau] = by_lag.get(tau, np.zeros(len(levers))) + column
    found = []
    for sensor, by_lag in columns.items():
        own = np.ones((n, 1)) if np.ndim(covariates[sensor]) == 0 else readings
        F = _factor({tau: g for tau, g in by_lag.items() if g.any()}, own, covariates, a)
        if F is not None:
            found.append(_noise_block(sensor, F))
    return found


def _drifts(model: MachineModel) -> list[tuple[int, ThermalEstimate]]:
    """(index of the term, thermal model)."""
    return [
        (t, term.basis.estimate)
        for t, term in enumerate(model.terms)
        if isinstance(term.basis, ThermalBasis)
    ]


def _readings(model: MachineModel, covariates: Covariates, n: int) -> FloatArray:
    """R (n, K): which of K distinct readings of all sensors each row has."""
    given = [np.asarray(covariates[s], float) for s in sensors_of(model)]
    columns = [column for column in given if column.ndim]
    if not columns:
        return np.ones((n, 1))
    _, which = np.unique(np.column_stack(columns), axis=0, return_inverse=True)
    return np.eye(int(which.max()) + 1)[which.reshape(-1)]


def _factor(
    by_lag: dict[float, FloatArray], readings: FloatArray, covariates: Covariates, axes: int
) -> FloatArray | None:
    """F (rows, K), or (rows,) where every row has a reading of its own; None without noise."""
    if not by_lag:
        return None
    times = row_times(covariates)
    n, count = readings.shape
    if times is None or count == 1 or not any(by_lag):
        total = np.sum(list(by_lag.values()), axis=0)
        if count == n > 1:
            return np.asarray(total)
        return np.asarray(total[:, None] * np.repeat(readings, axes, axis=0))
    order = np.argsort(times, kind="stable")
    lagged = lag_of_moments(readings[order], times[order], np.array(list(by_lag)))
    through = np.empty_like(lagged)
    through[:, order] = lagged
    F = np.zeros((n * axes, count))
    for g, own in zip(by_lag.values(), through, strict=True):
        F += g[:, None] * np.repeat(own, axes, axis=0)
    return F


def _noise_block(sensor: str, F: FloatArray) -> Block:
    """Standard normal quantities times F (rows, K), or one a point times F (rows,)."""
    rows, of_its_own = len(F), F.ndim == 1
    K = 1 if of_its_own else F.shape[1]
    return Block(
        names=(sensor,),
        columns=(slice(0, K),),
        G=np.zeros((rows, 1)) if of_its_own else F,
        C=np.zeros((K, K)),
        D=np.eye(K),
        noise=F[:, None] if of_its_own else np.zeros((rows, 1)),
        pass_dof=np.inf,
        repeat_dof=(np.inf,),
    )


SLACK = 0.05
"""Share of the fitted range of temperatures that may be exceeded without a word."""


def temperature_warnings(
    model: MachineModel, points: FloatArray, covariates: Covariates
) -> list[Finding]:
    """Temperatures beyond those of the fit, and lags without a history.

    `points` (n, 3) in mm, `covariates` one value for all or one a point.
    """
    drifts = model.drifts()
    if not drifts:
        return []

    @cache
    def steepest() -> dict[str, float]:
        levers = design(model, points, covariates).levers
        gradients = temperature_gradients(model, points, levers)
        return {sensor: float(np.abs(own).max()) for sensor, own in gradients.items()}

    return [
        *_outside(drifts, covariates, steepest),
        *_settled(drifts, covariates),
    ]


Steepest = Callable[[], dict[str, float]]
"""The largest |dE/dT| among the points by sensor, mm per degC."""


def _outside(
    drifts: tuple[ThermalEstimate, ...], covariates: Covariates, steepest: Steepest
) -> list[Finding]:
    """One a sensor and range, for all drifts that were read in it."""
    left: dict[tuple[str, float, float], list[str]] = {}
    for drift in drifts:
        if drift.temperature_range is None:
            continue
        for sensor, (low, high) in zip(
            drift.sensors, drift.temperature_range.tolist(), strict=True
        ):
            given = np.asarray(covariates[sensor], float)
            if max(low - given.min(), given.max() - high) > max(SLACK * (high - low), 1e-9):
                left.setdefault((sensor, low, high), []).append(drift.component)
    found = []
    for (sensor, low, high), names in left.items():
        given = np.atleast_1d(np.asarray(covariates[sensor], float))
        beyond = np.maximum(low - given, given - high)
        worst = int(np.argmax(beyond))
        wrong = 1e3 * steepest()[sensor] * float(beyond[worst])
        found.append(
            finding(
                "outside-measured-range",
                what=f"{sensor} at {given[worst]:.4g} degC (up to {wrong:.2g} um)",
                names=[f"the drift of {listed(names)}"],
                sensor=sensor,
                low=low,
                high=high,
                unit="degC",
            )
        )
    return found


def _settled(drifts: tuple[ThermalEstimate, ...], covariates: Covariates) -> list[Finding]:
    times = covariates.get(TIME)
    lagged = [drift for drift in drifts if drift.time_constants.any()]
    if not lagged or (times is not None and np.ndim(times) > 0 and np.ptp(times) > 0):
        return []
    slowest = max(float(drift.time_constants.max()) for drift in lagged)
    names = [drift.component for drift in lagged]
    return [finding("settled-temperatures", components=names, minutes=slowest)]
