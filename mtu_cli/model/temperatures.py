"""What the temperatures of a prediction add: noise of the sensors, and what to warn of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.machine_model import (
    TIME,
    Covariates,
    MachineModel,
    ThermalBasis,
    design,
    disagreement,
    places,
    row_times,
    sensors_of,
)
from mtu_cli.model.variance import Block, normal_block
from mtu_cli.stats.lag import lag_of_moments
from mtu_cli.stats.least_squares import FloatArray


def temperature_gradients(
    model: MachineModel,
    points: FloatArray,
    levers: FloatArray,
    *,
    noise: bool = False,
) -> dict[str, FloatArray]:
    """dE/dT_s (rows,) in mm per degC of every sensor: lever sum_m g[m, s] p^m over all drifts.

    `points` (n, 3), `levers` (rows, terms) as `design` gives them. With `noise` times u(T_s), in
    mm: what one standard uncertainty of a reading does to the errors once they have settled.
    """
    place, n = places(model, points), len(points)
    found: dict[str, FloatArray] = {}
    for t, drift in _drifts(model):
        position = np.zeros(n) if drift.of is None else place[drift.of]
        gradients = np.polynomial.polynomial.polyval(position, drift.coefficients)
        for s, sensor in enumerate(drift.sensors):
            factor = float(drift.sensor_u[s]) if noise else 1.0
            own = levers[:, t] * np.repeat(gradients[s] * factor, len(levers) // n)
            found[sensor] = found.get(sensor, np.zeros(len(levers))) + own
    return found


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
        own_noise = temperature_gradients(one, points, levers[:, [t]], noise=True)
        for sensor, column in own_noise.items():
            tau = float(drift.time_constants[drift.sensors.index(sensor)])
            by_lag = columns.setdefault(sensor, {})
            by_lag[tau] = by_lag.get(tau, np.zeros(len(levers))) + column
    found = []
    for sensor, by_lag in columns.items():
        own = np.ones((n, 1)) if np.ndim(covariates[sensor]) == 0 else readings
        F = _factor({tau: g for tau, g in by_lag.items() if g.any()}, own, covariates, a)
        if F is not None:
            found.append(normal_block(sensor, F, of_part=True))
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


SLACK = 0.05
"""Share of the fitted range of temperatures that may be exceeded without a word."""


def temperature_warnings(
    model: MachineModel, points: FloatArray, covariates: Covariates
) -> list[Finding]:
    """Temperatures beyond those of the fit, one warning a sensor and range for all drifts that were
    read in it, and lags without a history.

    `points` (n, 3) in mm, `covariates` one value for all or one a point.
    """
    left: dict[tuple[str, float, float], list[str]] = {}
    for drift in model.drifts():
        ranges = [] if drift.temperature_range is None else drift.temperature_range.tolist()
        for sensor, (low, high) in zip(drift.sensors, ranges, strict=False):
            given = np.asarray(covariates[sensor], float)
            if max(low - given.min(), given.max() - high) > max(SLACK * (high - low), 1e-9):
                left.setdefault((sensor, low, high), []).append(drift.component)
    gradients = {}
    if left:
        levers = design(model, points, covariates).levers
        gradients = temperature_gradients(model, points, levers)
    warnings = []
    for (sensor, low, high), names in left.items():
        given = np.atleast_1d(np.asarray(covariates[sensor], float))
        beyond = np.maximum(low - given, given - high)
        worst = int(np.argmax(beyond))
        wrong = 1e3 * float(np.abs(gradients[sensor]).max()) * float(beyond[worst])
        warnings.append(
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
    times = covariates.get(TIME)
    lagged = [drift for drift in model.drifts() if drift.time_constants.any()]
    if lagged and (times is None or np.ndim(times) == 0 or np.ptp(times) == 0):
        slowest = max(float(drift.time_constants.max()) for drift in lagged)
        names = [drift.component for drift in lagged]
        warnings.append(finding("settled-temperatures", components=names, minutes=slowest))
    return warnings


def moment_problem(model: MachineModel, points: Points, covariates: Covariates) -> Finding | None:
    """The disagreement of measured points (n,) with their covariates (n,), with file and rows."""
    found = [disagreement(drift, covariates) for drift in model.drifts()]
    first = next((each for each in found if each is not None), None)
    if first is None:
        return None
    sensor, i, j = first
    value = np.asarray(covariates[sensor])
    files = [points.sources[points.file_index[k]].shown for k in (i, j)]
    other = f"row {points.row[i]}" + (f" of {files[0]}" if files[0] != files[1] else "")
    return finding(
        "contradicts",
        other=f"{value[i]:g} degC at the same time ({other})",
        value=f"{value[j]:g} degC",
        file=files[1],
        row=int(points.row[j]),
        column=sensor,
        expected="times that run on over all parts: the drift lags behind its temperatures",
    )
