"""Temperatures of one moment: a drift that lags asks that rows of equal times agree."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.basis import AGREE_DEGC, Covariates, row_times
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.stats.lag import farthest_at_once


def disagreement(model: MachineModel, covariates: Covariates) -> tuple[str, int, int] | None:
    """(sensor, row, row): two rows of one time whose temperatures cannot both be right.

    None where no drift lags, no times are given, or all rows of every moment agree.
    """
    times = row_times(covariates)
    if times is None:
        return None
    for drift in model.drifts():
        for sensor, tau in zip(drift.sensors, drift.time_constants.tolist(), strict=True):
            value = np.asarray(covariates[sensor], float)
            found = farthest_at_once(value, times) if tau > 0 and value.ndim else None
            if found is not None and found[2] > AGREE_DEGC:
                return sensor, found[0], found[1]
    return None


def moment_problem(model: MachineModel, points: Points, covariates: Covariates) -> Finding | None:
    """The disagreement of measured points (n,) with their covariates (n,), with file and rows."""
    found = disagreement(model, covariates)
    if found is None:
        return None
    sensor, i, j = found
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
