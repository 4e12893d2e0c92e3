"""What the temperatures of a prediction add: noise of the sensors, and what to warn of."""

from __future__ import annotations

from collections.abc import Iterator

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
) -> Iterator[tuple[str, float, FloatArray]]:
    """Of every drift: sensor, its lag in min, and dE/dT (rows,), with `noise` times u(T)."""
    place, n = places(model, points), len(points)
    for t, drift in ((t, term.drift) for t, term in enumerate(model.terms)):
        if drift is None:
            continue
        gradients = drift.gradients(np.zeros(n) if drift.of is None else place[drift.of])
        for s, sensor in enumerate(drift.sensors):
            each = gradients[s] * (float(drift.sensor_u[s]) if noise else 1.0)
            column = levers[:, t] * np.repeat(each, len(levers) // max(n, 1))
            yield sensor, float(drift.time_constants[s]), column


def temperature_gradients(
    model: MachineModel, points: FloatArray, levers: FloatArray, *, noise: bool = False
) -> dict[str, FloatArray]:
    """dE/dT_s (rows,) in mm per degC of every sensor: lever sum_m g[m, s] p^m over all drifts.

    `points` (n, 3), `levers` (rows, terms) as `design` gives them. With `noise` times u(T_s), in
    mm: what one standard uncertainty of a reading does to the errors once they have settled.
    """
    result: dict[str, FloatArray] = {}
    for sensor, _, column in _by_sensor(model, points, levers, noise=noise):
        result[sensor] = result.get(sensor, 0.0) + column
    return result


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[Block]:
    """What the noise of the temperature readings adds to the errors at `points` (n, 3).

    Rows with the same temperatures share one reading, and its error; other readings are
    independent. A lag is linear in the readings, u = L T: with times, the noise of earlier
    readings comes through it as they do, and rows near in time are wrong together. With R
    (n, K) the readings of the rows, sensor s of noise u_s adds F F', F = diag(dE/dT_s) u_s L R.
    """
    n, a, times = len(points), len(model.axes), row_times(covariates)
    columns: dict[str, dict[float, FloatArray]] = {}
    for sensor, tau, column in _by_sensor(model, points, levers, noise=True):
        by_lag = columns.setdefault(sensor, {})
        by_lag[tau] = by_lag.get(tau, 0.0) + column
    given = [np.asarray(covariates[sensor], float) for sensor in sensors_of(model)]
    each, which = [column for column in given if column.ndim], np.zeros(n, np.int64)
    if each:
        which = np.unique(np.column_stack(each), axis=0, return_inverse=True)[1].reshape(-1)
    result = []
    for sensor, by_lag in columns.items():
        R = np.ones((n, 1))
        if np.ndim(covariates[sensor]):
            R = np.eye(int(which.max()) + 1)[which]
        live = {tau: column for tau, column in by_lag.items() if column.any()}
        lags, K = np.array(list(live)), R.shape[1]
        through = np.broadcast_to(R, (len(live), n, K))
        if times is not None and K > 1 and lags.any():
            order = np.argsort(times, kind="stable")
            through = np.empty((len(live), n, K))
            through[:, order] = first_order_lag(R[order], times[order], lags)
        elif K == n > 1 and live:
            # Every row has a reading of its own.
            result.append(normal_block(sensor, np.sum([*live.values()], axis=0), of_part=True))
            continue
        parts = zip(live.values(), through, strict=True)
        F = sum((g[:, None] * np.repeat(own, a, axis=0) for g, own in parts), np.zeros((n * a, K)))
        if live:
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
