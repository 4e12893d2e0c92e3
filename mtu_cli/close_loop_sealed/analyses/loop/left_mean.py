"""A mean error beside effects that were found, which does not pass among all tests.

A squareness is counted from the middle of the places: where the axis is right elsewhere its mean is
an offset. One that is not found is not written, and is not known to be 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import stdtr

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.growth_alone import growths_alone
from mtu_cli.close_loop_sealed.analyses.loop.own_constant import with_offset
from mtu_cli.close_loop_sealed.analyses.loop.result import LeftMean, TableResult

LIKELY = 0.01
"""p (t test) of no mean below which it is told."""
NOT_SURE = 0.2
"""The same of one beside an effect whose equation has a mean itself: without a level it is taken
for known that there is none, and errors at all places and times are off by what there is.
"""


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
        if beside is not None:
            whole = added(prepared, beside)
            mean = _mean(whole, whole.offset(axis), prepared.table.axes[axis], LIKELY)
        else:
            mean = _beside_own(told, axis)
        means += [] if mean is None else [mean]
    return tuple(means)


def _beside_own(told: Described, axis: int) -> LeftMean | None:
    """Beside an effect that has a mean of its own, with which the mean error agrees: that has no
    level. What is written is off by it all the same.
    """
    prepared, found = told.prepared, told.found
    if any(level.axis == axis for level in told.effects.levels):
        return None
    for place, m in enumerate(found.members):
        if any(axis in column for column in prepared.members[m].columns):
            whole = added(prepared, found, owners={axis: place})
            at = next((x.index for x in whole.levels if x.axis == axis), None)
            if at is not None:
                return _mean(whole, at, prepared.table.axes[axis], NOT_SURE)
    return None


def _mean(effects: Added, at: int, axis: str, most: float) -> LeftMean | None:
    """Coefficient `at` where its p of 0 is less than `most`."""
    fit = effects.fit
    if fit is None:
        return None
    value, u = float(fit.beta[at]), float(np.sqrt(fit.covariance[at, at]))
    p = 2 * float(stdtr(max(float(fit.dof[at]), 1.0), -abs(value) / u)) if u > 0 else 1.0
    return LeftMean(axis=axis, value=value, u=u, p=p) if p < most else None
