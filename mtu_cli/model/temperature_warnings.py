"""What to warn of where a thermal model meets the temperatures of a prediction."""

from __future__ import annotations

import numpy as np

from mtu_cli.model.basis import TIME, Covariates
from mtu_cli.model.design import design
from mtu_cli.model.machine_model import MachineModel, sensors_of
from mtu_cli.model.settings import Warned
from mtu_cli.model.temperature_noise import temperature_gradients
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

OTHERS_MOVE = 0.5
"""degC by which the other sensors must move for one that stands still to look stuck."""


def temperature_warnings(
    model: MachineModel, points: FloatArray, covariates: Covariates
) -> list[Warned]:
    """Temperatures beyond those of the fit, lags without a history, and sensors that stick.

    `points` (n, 3) in mm, `covariates` one value for all or one a point.
    """
    drifts = model.drifts()
    if not drifts:
        return []
    found = [item for drift in drifts for item in _outside(drift, covariates)]
    return [*found, *_settled(drifts, covariates), *_stuck(model, points, covariates)]


def _outside(drift: ThermalEstimate, covariates: Covariates) -> list[Warned]:
    if drift.temperature_range is None:
        return []
    found = []
    for sensor, (low, high) in zip(drift.sensors, drift.temperature_range, strict=True):
        given = np.asarray(covariates[sensor], float)
        beyond = max(low - given.min(), given.max() - high)
        if beyond > max(0.05 * (high - low), 1e-9):
            value = given.min() if low - given.min() == beyond else given.max()
            found.append(
                Warned(
                    code="outside-temperature-range",
                    message=f"the drift of {drift.component} was read with {sensor} from "
                    f"{low:.4g} to {high:.4g} degC: at {value:.4g} degC it is a guess",
                )
            )
    return found


def _settled(drifts: tuple[ThermalEstimate, ...], covariates: Covariates) -> list[Warned]:
    times = covariates.get(TIME)
    lagged = [drift for drift in drifts if drift.time_constants.any()]
    if not lagged or (times is not None and np.ndim(times) > 0 and np.ptp(times) > 0):
        return []
    slowest = max(float(drift.time_constants.max()) for drift in lagged)
    names = ", ".join(drift.component for drift in lagged)
    return [
        Warned(
            code="settled-temperatures",
            message=f"the drift of {names} follows its temperatures with lags of up to "
            f"{slowest:g} min: without a history they count as settled",
        )
    ]


def _stuck(model: MachineModel, points: FloatArray, covariates: Covariates) -> list[Warned]:
    """Sensors that stand still while the others move, with what that may cost."""
    sensors = list(sensors_of(model))
    moved = np.array([np.ptp(np.asarray(covariates[sensor], float)) for sensor in sensors])
    found = []
    gradients: dict[str, FloatArray] | None = None
    for s, sensor in enumerate(sensors):
        others = np.delete(moved, s)
        if moved[s] > 0 or not len(others) or np.median(others) < OTHERS_MOVE:
            continue
        if gradients is None:
            levers = design(model, points, covariates).levers
            gradients = temperature_gradients(model, points, levers)
        wrong = 1e3 * float(np.abs(gradients[sensor]).max() * np.median(others))
        found.append(
            Warned(
                code="sensor-stuck",
                message=f"{sensor} stands still while the other sensors move by "
                f"{np.median(others):.2g} degC: if it sticks, errors are wrong by up to "
                f"{wrong:.2g} um",
            )
        )
    return found
