"""A mean error beside effects that were found, which does not pass among all tests.

A squareness is counted from the middle of the places: where the axis is right elsewhere its mean is
an offset. One that is not found is not written, and is not known to be 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import stdtr

from mtu_cli.analyses.close_loop.added import added
from mtu_cli.analyses.close_loop.describe import Described
from mtu_cli.analyses.close_loop.growth_alone import growths_alone
from mtu_cli.analyses.close_loop.own_constant import with_offset
from mtu_cli.analyses.close_loop.result import LeftMean, TableResult

LIKELY = 0.01
"""p (t test) of no mean below which it is told."""


def with_left(result: TableResult, told: Described, seed: int) -> TableResult:
    """The result with what stands beside its effects and is no finding."""
    alone = growths_alone(told, result.effects, result.fixed_points, seed)
    return replace(result, growths_alone=alone, left_means=left_means(told))


def left_means(told: Described) -> tuple[LeftMean, ...]:
    """Of each axis along which an effect with columns was found, and no offset or level."""
    prepared, found = told.prepared, told.found
    if prepared.table.component is not None:
        return ()
    along = {a for m in found.members for c in prepared.members[m].columns for a in c}
    means = []
    for index, axis in enumerate(prepared.scan.offsets, len(prepared.scan.columns)):
        if axis not in along or any(step.index == index for step in found.steps):
            continue
        beside = with_offset(prepared, found, index, axis)
        whole = None if beside is None else added(prepared, beside)
        if whole is None or whole.fit is None:
            continue
        at = whole.offset(axis)
        value, u = float(whole.fit.beta[at]), float(np.sqrt(whole.fit.covariance[at, at]))
        p = 2 * float(stdtr(max(float(whole.fit.dof[at]), 1.0), -abs(value) / u)) if u > 0 else 1.0
        if p < LIKELY:
            means.append(LeftMean(axis=prepared.table.axes[axis], value=value, u=u, p=p))
    return tuple(means)
