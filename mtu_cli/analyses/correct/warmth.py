"""Temperatures of the points that nothing in the model goes by."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import MachineModel

FAR_K = 1.0
"""A machine this far from its reference temperature errs by 10 um in each metre and more."""


def unused_warmth(model: MachineModel, points: Points, reference: float) -> list[Finding]:
    """A warning where sensors of the points were more than `FAR_K` from the `reference` in degC,
    but the model has no thermal component and no effect of a temperature.
    """
    if any(is_temperature(name) for name in model.covariates()):
        return []
    far: dict[str, float] = {}
    for name, column in points.covariates.items():
        if not is_temperature(name) or column.dtype == object:
            continue
        away = np.abs(column.astype(np.float64) - reference)
        worst = int(np.argmax(np.where(np.isfinite(away), away, -np.inf)))
        if away[worst] > FAR_K:
            far[name] = float(column[worst])
    if not far:
        return []
    name = max(far, key=lambda key: abs(far[key] - reference))
    others = f"; {len(far) - 1} more sensors" if len(far) > 1 else ""
    return [
        finding(
            "no-thermal-component",
            reference=reference,
            sensor=name,
            reading=far[name],
            others=others,
            expected="--drift FILE, or -c with a report of thermal-fit",
        )
    ]
