"""What the temperatures of a prediction add: noise of the sensors, and what to warn of."""

from __future__ import annotations

import numpy as np

from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.machine_model import (
    Covariates,
    MachineModel,
    design,
    places,
    row_times,
    sensors_of,
)
from mtu_cli.model.variance import Block, normal_block
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray

SLACK = 0.05
"""Share of the fitted range of temperatures that may be exceeded without a word."""


def _by_sensor(
    model: MachineModel, points: FloatArray, levers: FloatArray, *, noise: bool
) -> dict[str, dict[float, FloatArray]]:
    """dE/dT (rows,) by sensor and lag in min, over all drifts; with `noise` times u(T)."""
    place, n = places(model, points), len(points)
    result: dict[str, dict[float, FloatArray]] = {}
    for lever, drift in zip(levers.T, (term.drift for term in model.terms), strict=True):
        if drift is None:
            continue
        gradients = drift.gradients(np.zeros(n) if drift.of is None else place[drift.of])
        gradients = gradients * (drift.sensor_u[:, None] if noise else 1.0)
        for sensor, tau, each in zip(
            drift.sensors, drift.time_constants.tolist(), gradients, strict=True
        ):
            column = lever * np.repeat(each, len(levers) // max(n, 1))
            by_lag = result.setdefault(sensor, {})
            by_lag[tau] = by_lag.get(tau, 0.0) + column
    return result


def temperature_gradients(
    model: MachineModel, points: FloatArray, levers: FloatArray, *, noise: bool = False
) -> dict[str, FloatArray]:
    """dE/dT_s (rows,) in mm per degC of every sensor: lever sum_m g[m, s] p^m over all drifts.

    `points` (n, 3), `levers` (rows, terms) as `design` gives them. With `noise` times u(T_s), in
    mm: what one standard uncertainty of a reading does to the errors once they have settled.
    """
    found = _by_sensor(model, points, levers, noise=noise)
    return {sensor: np.sum([*by_lag.values()], axis=0) for sensor, by_lag in found.items()}


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[Block]:
    """What the noise of the temperature readings adds to the errors at `points` (n, 3).

    Rows with the same temperatures share one reading, and its error; other readings are
    independent. A lag is linear in the readings, u = L T: with times, the noise of earlier
    readings comes through it as they do, and rows near in time are wrong together. With R
    (n, K) the readings of the rows, sensor s of noise u_s adds F F', F = diag(dE/dT_s) u_s L R.
    """
    n, times = len(points), row_times(covariates)
    each = [np.asarray(covariates[sensor], float) for sensor in sensors_of(model)]
    each = [column for column in each if column.ndim]
    which, result = np.zeros(n, np.int64), list[Block]()
    if each:
        which = np.unique(np.column_stack(each), axis=0, return_inverse=True)[1].reshape(-1)
    for sensor, by_lag in _by_sensor(model, points, levers, noise=True).items():
        live = {tau: column for tau, column in by_lag.items() if column.any()}
        readings = int(which.max()) + 1 if np.ndim(covariates[sensor]) else 1
        lagged = times is not None and readings > 1 and any(live)
        if not live:
            continue
        if readings == n > 1 and not lagged:
            # Every row has a reading of its own.
            F = np.sum([*live.values()], axis=0)
        else:
            R = np.eye(readings)[which if readings > 1 else np.zeros(n, np.int64)]
            through = np.broadcast_to(R, (len(live), n, readings))
            if times is not None and lagged:
                order = np.argsort(times, kind="stable")
                through = np.empty((len(live), n, readings))
                through[:, order] = first_order_lag(R[order], times[order], np.array([*live]))
            F = np.zeros((len(levers), readings))
            for column, own in zip(live.values(), through, strict=True):
                F += column[:, None] * np.repeat(own, len(levers) // n, axis=0)
        result.append(normal_block(sensor, F, of_part=True))
    return result


def temperature_warnings(
    model: MachineModel, points: FloatArray, covariates: Covariates
) -> list[Finding]:
    """Temperatures beyond those of the fit, one warning a sensor and range for all drifts that were
    read in it, and lags without a history.

    `points` (n, 3) in mm, `covariates` one value for all or one a point.
    """
    beyond: dict[tuple[str, float, float], list[str]] = {}
    for drift in model.drifts():
        ranges = [] if drift.temperature_range is None else drift.temperature_range.tolist()
        for sensor, (low, high) in zip(drift.sensors, ranges, strict=False):
            given = np.asarray(covariates[sensor], float)
            if max(low - given.min(), given.max() - high) > max(SLACK * (high - low), 1e-9):
                beyond.setdefault((sensor, low, high), []).append(drift.component)
    warnings, gradients = [], {}
    if beyond:
        levers = design(model, points, covariates).levers
        gradients = temperature_gradients(model, points, levers)
    for (sensor, low, high), names in beyond.items():
        given = np.atleast_1d(np.asarray(covariates[sensor], float))
        away = np.maximum(low - given, given - high)
        worst = int(np.argmax(away))
        wrong = 1e3 * float(np.abs(gradients[sensor]).max()) * float(away[worst])
        what = f"{sensor} at {given[worst]:.4g} degC (up to {wrong:.2g} um)"
        facts = {"sensor": sensor, "low": low, "high": high, "unit": "degC"}
        of = [f"the drift of {listed(names)}"]
        warnings.append(finding("outside-measured-range", what=what, names=of, **facts))
    times = row_times(covariates)
    lagged = [drift for drift in model.drifts() if drift.time_constants.any()]
    if lagged and (times is None or np.ptp(times) == 0):
        slowest = max(float(drift.time_constants.max()) for drift in lagged)
        names = [drift.component for drift in lagged]
        warnings.append(finding("settled-temperatures", components=names, minutes=slowest))
    return warnings
