"""A growth that was found without the drift of the place it is counted from.

About the middle of the places an axis that grows from a fixed point shows a growth and a drift of
the middle. Where only the growth passes, what is written leaves the middle where it is: where the
axis is fixed is then known no better than how far the middle may go.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint
from mtu_cli.close_loop_sealed.analyses.loop.crossing import counted_from
from mtu_cli.close_loop_sealed.analyses.loop.describe import (
    Described,
    found_effects,
    joint_covariance,
)
from mtu_cli.close_loop_sealed.analyses.loop.fixed_point import fixed_points, levers_of
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import depended_on, extent
from mtu_cli.close_loop_sealed.model.effect_library import Member


def growths_alone(
    told: Described,
    effects: Sequence[FoundEffect],
    points: Sequence[FixedPoint],
    seed: int | None = None,
) -> tuple[FixedPoint, ...]:
    """One for each growth with a covariate that stands alone in its class and has no part in a
    fixed point of `points`; its `drift` is empty.

    Where the axis is fixed is estimated beside a drift of the same covariate, whether that passes
    or not: as in `fixed_points`, nan and not `told` where the data have no such drift.
    """
    table = told.prepared.table
    in_one = {e for point in points for e in (*point.growth, *point.drift)}
    found = []
    for e, effect in enumerate(effects):
        axis, known = effect.axis, effect.covariate
        lone = len(effect.candidates) == 1 and e not in in_one and table.component is None
        if not lone or axis is None or known is None:
            continue
        if _depends(effect.equations, axis, effect.parameters) != {axis, known}:
            continue
        levers = list(levers_of(table, axis, effect, e, frozenset({known})))
        start = counted_from(levers, *extent(table, axis))
        if np.isfinite(start):
            point = _beside_drift(told, e, axis, known, seed)
            found.append(replace(point, drift=(), counted_from=start))
    return tuple(found)


def _beside_drift(told: Described, e: int, axis: str, known: str, seed: int | None) -> FixedPoint:
    """The fixed point that effect `e` and a drift of the axis with the covariate `known` give."""
    for index, member in _drifts(told, axis, known):
        step = Step(
            index=index, member=member, p=1.0, log_bayes=0.0, posterior=0.0, credible=(index,)
        )
        found = replace(told.found, steps=(*told.found.steps, step))
        other = replace(told, found=found, effects=added(told.prepared, found, seed))
        effects = found_effects(other, [None] * len(found.steps))
        given = fixed_points(told.prepared.table, effects, joint_covariance(other))
        for point in given:
            if point.axis == axis and point.growth == (e,):
                return point
    return FixedPoint(
        axis=axis,
        covariate=known,
        growth=(e,),
        drift=(),
        at=np.nan,
        u=np.nan,
        interval=None,
        told=False,
    )


def _drifts(told: Described, axis: str, known: str) -> Iterator[tuple[int, int]]:
    """Candidates, not found, with their members that shift the axis alone by the covariate."""
    taken = {step.index for step in told.found.steps}
    first = 0
    for index, own in enumerate(told.prepared.scan.columns):
        for m in range(first, first + len(own)):
            member = told.prepared.members[m]
            alone = len(member.parameters) == 1 and set(member.equations) == {f"E{axis}"}
            over = _depends(member.equations, axis, member.parameters) if alone else set()
            if index not in taken and over == {known} and _by(member, known):
                yield index, m
        first += len(own)


def _by(member: Member, known: str) -> bool:
    """Whether it is of this covariate, as it is: nothing of it was searched."""
    return member.covariate == known and not member.searched


def _depends(
    equations: Mapping[str, str], axis: str, parameters: Sequence[tuple[Any, ...]]
) -> set[str]:
    """What an error along an axis depends on beside its parameters (name first)."""
    text = equations.get(f"E{axis}")
    return set() if text is None else depended_on(text, parameters)
