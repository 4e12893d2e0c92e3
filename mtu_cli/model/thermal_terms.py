"""Thermal models as terms of a machine."""

from __future__ import annotations

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.thermal import ThermalEstimate

TEMPERATURE_MARK = ".temperature"
LEFTOVER_MARK = ".leftover"


def term_label(name: str) -> str:
    """The name of a term as messages have it: the drift of its component for a thermal one."""
    component = name.removesuffix(TEMPERATURE_MARK)
    return name if component == name else f"the drift of {component}"


def temperature_estimate(drift: ThermalEstimate) -> ComponentEstimate:
    """The coefficients of a drift as those of a component, powers first, then sensors."""
    size = drift.coefficients.size
    return ComponentEstimate(
        name=f"{drift.component}{TEMPERATURE_MARK}",
        of=drift.of,
        unit=drift.unit,
        coefficients=drift.coefficients.reshape(-1),
        covariance=drift.covariance,
        pass_covariance=np.zeros((size, size)),
        s_repeat=0.0,
        pass_dof=drift.coefficient_dof,
        repeat_dof=np.inf,
        # What does not depend on the position holds beyond the positions where it was read.
        position_range=drift.position_range if drift.degree else None,
    )


def leftover_estimate(drift: ThermalEstimate) -> ComponentEstimate:
    """What the thermal model leaves: mean 0, one draw for all points of a part."""
    size = len(drift.leftover)
    return ComponentEstimate(
        name=f"{drift.component}{LEFTOVER_MARK}",
        of=drift.of,
        unit=drift.unit,
        coefficients=np.zeros(size),
        covariance=np.zeros((size, size)),
        pass_covariance=drift.leftover,
        s_repeat=0.0,
        pass_dof=drift.leftover_dof,
        repeat_dof=np.inf,
    )
