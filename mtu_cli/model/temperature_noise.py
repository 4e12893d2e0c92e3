"""What the noise of temperature readings adds to the errors of points."""

from __future__ import annotations

import numpy as np

from mtu_cli.model.basis import TIME, Covariates, ThermalBasis
from mtu_cli.model.design import places
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.model.variance import Block
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


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[Block]:
    """What the noise of the temperature readings adds to the errors at `points` (n, 3).

    dE/dT_s times the sensor's u. Points that share one reading of all temperatures share its
    error; points with readings of their own do not. A lag of time constant tau averages
    readings that are dt apart: their noise counts with sqrt(dt/(2 tau)) of itself.
    """
    drifts = [drift for _, drift in _drifts(model)]
    shared = all(_one_reading(covariates, drift.sensors, len(points)) for drift in drifts)
    share = {
        drift.component: {
            sensor: u * (1.0 if shared else _averaged(tau, covariates))
            for sensor, u, tau in zip(
                drift.sensors, drift.sensor_u.tolist(), drift.time_constants, strict=True
            )
        }
        for drift in drifts
    }
    columns = temperature_gradients(model, points, levers, share)
    return [
        _noise_block(sensor, column, shared=shared)
        for sensor, column in columns.items()
        if column.any()
    ]


def _drifts(model: MachineModel) -> list[tuple[int, ThermalEstimate]]:
    """(index of the term, thermal model)."""
    return [
        (t, term.basis.estimate)
        for t, term in enumerate(model.terms)
        if isinstance(term.basis, ThermalBasis)
    ]


def _one_reading(covariates: Covariates, sensors: tuple[str, ...], n: int) -> bool:
    """Whether all points have one and the same temperatures."""
    return n == 1 or all(np.ptp(np.asarray(covariates[sensor])) == 0 for sensor in sensors)


def _averaged(time_constant: float, covariates: Covariates) -> float:
    times = covariates.get(TIME)
    steps = np.zeros(0) if times is None else np.diff(np.unique(times))
    if not len(steps) or time_constant <= 0:
        return 1.0
    return min(float(np.sqrt(np.median(steps) / (2 * time_constant))), 1.0)


def _noise_block(sensor: str, column: FloatArray, *, shared: bool) -> Block:
    """A standard normal quantity times `column` (rows,), one for all points or one a point."""
    nothing = np.zeros_like(column)[:, None]
    return Block(
        names=(sensor,),
        columns=(slice(0, 1),),
        G=column[:, None] if shared else nothing,
        C=np.zeros((1, 1)),
        D=np.eye(1),
        noise=nothing if shared else column[:, None],
        pass_dof=np.inf,
        repeat_dof=(np.inf,),
    )
