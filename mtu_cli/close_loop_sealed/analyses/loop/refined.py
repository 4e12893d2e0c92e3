"""Pitches of periodic errors and shapes, such as time constants, between the values searched.

A grid of frequencies finds a wave; it lies up to an eighth of a period off at the ends of the data,
which is no estimate. The profile of the least squares over all frequencies about it has one, and so
has that over all time constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.fitted import beside_polynomial
from mtu_cli.close_loop_sealed.analyses.loop.folds import (
    CutCandidates,
    Split,
    cut_candidates,
    identity,
)
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import best_near, periodic
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import (
    best_shape,
    is_shaped,
    searched_values,
    shape_of,
)
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, EffectLibrary, Member
from mtu_cli.close_loop_sealed.model.effect_members import BoundTemplate
from mtu_cli.close_loop_sealed.model.effect_search import member_at, searched_template, waves_of
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.loop_frame import grouped


def searched_members(prepared: Prepared, found: Search, library: EffectLibrary) -> dict[int, float]:
    """Those of the members found of which a searched value is an estimate (a pitch, a time
    constant, no part from which on something jumped), with the relative standard uncertainty that
    the search alone leaves it: a pitch anywhere between the two beside it, another value anywhere
    on its grid, by its logarithm (JCGM 100:2008, 4.3.7).
    """
    values = {}
    for step in found.steps:
        candidate = prepared.candidates[step.index] if step.member >= 0 else None
        if candidate is None:
            continue
        member = prepared.members[step.member]
        if waves_of(prepared.table, library, candidate, member):
            (pitch,) = member.searched.values()
            values[step.member] = _apart(candidate, pitch) * pitch / math.sqrt(3)
        elif is_shaped(member):
            known = searched_values(candidate, member)
            # The logarithm is of what is greater than 0 throughout.
            if known[0] > 0:
                values[step.member] = math.log(known[-1] / known[0]) / math.sqrt(12)
    return values


def with_refined(
    told: Described, library: EffectLibrary, seed: int | None, owners: Mapping[int, int]
) -> Described:
    """The same with each periodic error at the pitch, and each shape at the value, that fits best
    beside all other effects.
    """
    table = told.prepared.table
    values = searched_members(told.prepared, told.found, library)

    def member(candidate: Candidate, bound: BoundTemplate, value: float, found: Member) -> Member:
        return _member(table, candidate, bound, value, found)

    def estimated(prepared: Prepared) -> Added:
        return added(prepared, told.found, seed, owners=owners, values=values)

    return _refined(told, library, member, estimated)


def with_refined_of_fold(
    prepared: Prepared,
    found: Search,
    table: ResidualTable,
    split: Split,
    cut: CutCandidates,
    library: EffectLibrary,
) -> tuple[Prepared, CutCandidates]:
    """What a fold found with each periodic error at the pitch, and each shape at the value, that
    fits what is kept the best; and its candidates with those on the whole `table`.
    """
    whole, weights = dict(cut.whole), dict(cut.weights)

    def member(
        candidate: Candidate, _: BoundTemplate, value: float, found: Member
    ) -> Member | None:
        bound = searched_template(table, library, candidate, found)
        if bound is None:
            return None
        own = replace(candidate, members=(_member(table, candidate, bound, value, found),))
        one = cut_candidates([own], split.kept, split.dimension)
        whole.update(one.whole)
        # It stands for all that the value of the grid stood for.
        known = weights[identity(candidate.name, found)]
        weights.update(dict.fromkeys(one.whole, known))
        return next(iter(one.candidates[0].members), None)

    def estimated(own: Prepared) -> Added:
        return added(own, found, rough=True)

    told = Described(prepared=prepared, found=found, effects=estimated(prepared), chosen=())
    refined = _refined(told, library, member, estimated)
    return refined.prepared, replace(cut, whole=whole, weights=weights)


def _refined(
    told: Described,
    library: EffectLibrary,
    member: Callable[[Candidate, BoundTemplate, float, Member], Member | None],
    estimated: Callable[[Prepared], Added],
) -> Described:
    """One wave or shape after the other; `member` is that of a value, None where the data has
    none.
    """
    steps = [step for step in told.found.steps if step.member >= 0]
    for place, step in enumerate(steps):
        candidate, found = told.prepared.candidates[step.index], told.prepared.members[step.member]
        best = _best(told, step, place, library)
        if best is None or best[1] in found.searched.values():
            continue
        own = member(candidate, *best, found)
        prepared = None if own is None else _with(told.prepared, step, own)
        if prepared is not None:
            told = replace(told, prepared=prepared, effects=estimated(prepared))
    return told


def _best(
    told: Described, step: Step, place: int, library: EffectLibrary
) -> tuple[BoundTemplate, float] | None:
    """What was searched of an effect, and the value that fits best; None where nothing was."""
    seen = periodic(told, step, library)
    if seen is not None:
        # Of a wave that shows one phase no pitch is told: a hidden one would fit it better.
        if len(seen.member.columns) < len(seen.waves.bound.parameters()):
            return None
        apart = _apart(told.prepared.candidates[step.index], seen.found)
        return seen.waves.bound, best_near(told, seen, place, apart)
    shape = shape_of(told.prepared, step, library)
    return None if shape is None else (shape[0], best_shape(told, step, place, *shape))


def _member(
    table: ResidualTable, candidate: Candidate, bound: BoundTemplate, value: float, found: Member
) -> Member:
    """The member of a value with the parameters of the one found, less the polynomial."""
    member = member_at(bound, value, {name for name, _ in found.parameters})
    (own,) = beside_polynomial(table, [replace(candidate, members=(member,))])
    return own.members[0]


def _apart(candidate: Candidate, pitch: float) -> float:
    """From the frequency of a pitch to the farther one of those searched beside it, 1/mm."""
    own = [m for m in candidate.members if m.searched]
    known = np.unique([1.0 / value for m in own for value in m.searched.values()])
    at = int(np.argmin(np.abs(known - 1.0 / pitch)))
    beside = known[max(at - 1, 0) : at + 2]
    return float(np.abs(beside - known[at]).max())


def _with(prepared: Prepared, step: Step, member: Member) -> Prepared | None:
    """With another member in place of the one found; None where the data does not see it."""
    frame, index = prepared.scan.frame, step.member
    (columns,) = grouped(frame.columns, [member.columns])
    (tangent,) = grouped(frame.columns, [member.tangent])
    if not all(columns):
        return None
    at = index - sum(len(own) for own in prepared.scan.columns[: step.index])
    of_all = list(prepared.scan.columns)
    of_all[step.index] = (*of_all[step.index][:at], columns, *of_all[step.index][at + 1 :])
    sloped = tuple(column for column in tangent if column)
    means = np.array([frame.means(column) for column in member.columns])
    return replace(
        prepared,
        members=(*prepared.members[:index], member, *prepared.members[index + 1 :]),
        means={**prepared.means, index: means},
        tangents={**prepared.tangents, **({index: sloped} if sloped else {})},
        scan=replace(prepared.scan, columns=tuple(of_all)),
    )
