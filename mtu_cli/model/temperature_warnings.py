"""What to warn of where a thermal model meets the temperatures of a prediction."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.basis import TIME, Covariates
from mtu_cli.model.design import design
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.temperature_noise import temperature_gradients
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

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
