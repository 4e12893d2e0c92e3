"""The parameters of declared effects, as components that a machine file states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.units import UNITS

EFFECT_MARK = "."
"""Stands between an effect and its parameter; no component's name holds it."""


def effect_estimates(
    effect: Any, rename: Mapping[str, str]
) -> tuple[dict[str, ComponentEstimate], list[JointPasses]]:
    """The parameters of an effect as components without an axis, known to their u.

    Where the effect states a covariance, it stands for the parameters' own u.
    """
    estimates: dict[str, ComponentEstimate] = {}
    factors = np.array([UNITS[p.unit].to_internal for p in effect.parameters.values()])
    if effect.covariance is None:
        C = np.diag([p.u**2 for p in effect.parameters.values()]) * np.outer(factors, factors)
    else:
        C = np.asarray(effect.covariance, float) * np.outer(factors, factors)
    for i, (name, parameter) in enumerate(effect.parameters.items()):
        unit = UNITS[parameter.unit]
        estimates[rename[name]] = ComponentEstimate(
            name=rename[name],
            of=None,
            unit=unit,
            coefficients=np.array([parameter.value * unit.to_internal]),
            covariance=C[i : i + 1, i : i + 1],
            pass_covariance=np.zeros((1, 1)),
            s_repeat=0.0,
            pass_dof=0.0,
            repeat_dof=np.inf,
        )
    if effect.covariance is None:
        return estimates, []
    group = JointPasses(
        components=tuple(estimates),
        widths=(1,) * len(estimates),
        covariance=C,
        pass_covariance=np.zeros_like(C),
        pass_dof=np.inf,
        n_passes=None,
    )
    return estimates, [group]
