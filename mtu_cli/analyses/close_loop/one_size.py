"""Whether an effect of several axes is of one size along all of them.

A growth of all axes is found before those of single ones where two of three grow alike: the third
would then be said to grow, and a scale that takes it off again be found beside it.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.close_loop.jointly import jointly
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.state import State, Step
from mtu_cli.stats.column_groups import MemberColumns
from mtu_cli.stats.joint_test import p_of_none
from mtu_cli.stats.least_squares import FloatArray

FAMILIES = ("thermal-growth",)
"""Those of which candidates of single axes stand beside the one of all."""
DISAGREES = 0.01
"""p (F) of one size below which it is not found."""


def is_one_size(state: State, step: Step) -> bool:
    """Whether the axes of a step agree in its size, beside what was found; True of one axis."""
    prepared = state.prepared
    if step.member < 0 or prepared.candidates[step.index].family not in FAMILIES:
        return True
    split = _by_axis(prepared, step.member)
    if len(split) < 2:
        return True
    _, fit = jointly(prepared, [*split, *prepared.whole(state.members)])
    k = len(split)
    contrasts = np.column_stack([np.ones(k - 1), -np.eye(k - 1)])
    d, V = contrasts @ fit.beta[:k], contrasts @ fit.covariance[:k, :k] @ contrasts.T
    p = p_of_none(d, V, float(fit.dof[:k].min()))
    return p is None or p >= DISAGREES


def _by_axis(prepared: Prepared, member: int) -> list[MemberColumns]:
    """The one column of a member, an axis at a time."""
    strata = prepared.scan.frame.strata.all
    (whole,) = prepared.whole([member])
    if len(whole) != 1:
        return []
    by_axis: dict[int, dict[int, FloatArray]] = {}
    for index, values in whole[0].items():
        by_axis.setdefault(strata[index].axis, {})[index] = values
    return [(column,) for _, column in sorted(by_axis.items())]
