"""Whether an effect of several axes is of one size along all of them.

A growth of all axes is found before those of single ones where two of three grow alike: the third
would then be said to grow, and a scale that takes it off again be found beside it. Sizes b (k,) of
the axes, with covariance V, agree by d = C b, C the k - 1 contrasts b_1 - b_i:
F = d' (C V C')^-1 d / (k - 1), the general linear hypothesis (Rao 1973, 4b.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.jointly import jointly
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import vary_alike
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.close_loop_sealed.stats.none_of_all import p_of_none
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit
from mtu_cli.stats.least_squares import FloatArray

FAMILIES = ("thermal-growth",)
"""Those of which candidates of single axes stand beside the one of all."""
DISAGREES = 0.01
"""p (F) of one size below which it is not found."""


def is_one_size(state: State, step: Step) -> bool:
    """Whether the axes of a step agree in its size, beside what was found; True of one axis. Where
    one of them was found by itself, in whatever form, they do not: what is left of it is no size.
    """
    prepared = state.prepared
    if step.member < 0 or prepared.candidates[step.index].family not in FAMILIES:
        return True
    split = _by_axis(prepared, step.member)
    if len(split) < 2:
        return True
    scan, flat = prepared.scan, prepared.scan.flat()
    found = [column for member in state.members for column in flat[member]]
    if any(vary_alike(scan, own, column) for (own,) in split for column in found):
        return False
    _, fit = jointly(prepared, [*split, *prepared.whole(state.members)])
    return _agree(fit, range(len(split)))


def of_no_size(prepared: Prepared, found: Sequence[int]) -> frozenset[int]:
    """Members of all axes that are no rivals of the members `found`: among these are growths of
    single axes with the same temperature, and they differ in size. Beside one of them those are the
    growth of another axis, but with a size that nobody has.
    """
    owners = prepared.scan.owners()
    alone: dict[tuple[str, str | None], dict[str, int]] = {}
    start = 0
    for m in found:
        own, count = prepared.candidates[owners[m]], len(prepared.members[m].columns)
        if own.family in FAMILIES and own.axis is not None and count == 1:
            of_axes = alone.setdefault((own.family, prepared.members[m].covariate), {})
            of_axes.setdefault(own.axis, start)
        start += count
    several = {known: [*axes.values()] for known, axes in alone.items() if len(axes) > 1}
    if not several:
        return frozenset()
    _, fit = jointly(prepared, prepared.whole(found))
    apart = {known for known, places in several.items() if not _agree(fit, places)}
    return frozenset(
        m
        for m, i in enumerate(owners)
        if prepared.candidates[i].axis is None
        and (prepared.candidates[i].family, prepared.members[m].covariate) in apart
    )


def _agree(fit: StratifiedFit, places: Sequence[int]) -> bool:
    """Whether coefficients are of one size; what cannot be told apart is."""
    k = len(places)
    contrasts = np.column_stack([np.ones(k - 1), -np.eye(k - 1)])
    d = contrasts @ fit.beta[[*places]]
    V = contrasts @ fit.covariance[np.ix_(places, places)] @ contrasts.T
    p = p_of_none(d, V, float(fit.dof[[*places]].min()))
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
