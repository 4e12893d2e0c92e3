"""The pitch of a periodic error between the values that were searched.

A grid of frequencies finds a wave; it lies up to an eighth of a period off at the ends of the data,
which is no estimate. The profile of the least squares over all frequencies about it has one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.added import Added, added
from mtu_cli.analyses.close_loop.describe import Described
from mtu_cli.analyses.close_loop.fitted import beside_polynomial
from mtu_cli.analyses.close_loop.folds import CutCandidates, Split, cut_candidates, identity
from mtu_cli.analyses.close_loop.other_pitches import Periodic, best_near, periodic
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.model.effect_library import Candidate, EffectLibrary, Member
from mtu_cli.model.effect_search import Waves, waves_of
from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.loop_frame import grouped


def searched_members(prepared: Prepared, found: Search, library: EffectLibrary) -> dict[int, float]:
    """Those of the members found of which a searched value is an estimate (a pitch, a time
    constant, no part from which on something jumped), with the relative standard uncertainty that
    the search alone leaves it: a pitch anywhere between the two beside it, another value anywhere
    on its grid.
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
        elif len(member.searched) == 1 and len(member.tangent) == len(member.columns):
            known = _searched(candidate, member)
            # Of places on either side of 0 there is no relative uncertainty.
            if min(known) > 0:
                values[step.member] = math.log(max(known) / min(known)) / math.sqrt(12)
    return values


def _searched(candidate: Candidate, member: Member) -> list[float]:
    """All values that were searched with the covariate of a member."""
    (name,) = member.searched
    return [m.searched[name] for m in candidate.members if m.covariate == member.covariate]


def with_refined_pitches(
    told: Described, library: EffectLibrary, seed: int, owners: Mapping[int, int]
) -> Described:
    """The same with each periodic error at the pitch that fits best beside all other effects."""
    table = told.prepared.table
    values = searched_members(told.prepared, told.found, library)

    def member(candidate: Candidate, seen: Periodic, pitch: float) -> Member:
        return _member(table, candidate, seen.waves, pitch, seen.member)

    def estimated(prepared: Prepared) -> Added:
        return added(prepared, told.found, seed, owners=owners, values=values)

    return _refined(told, library, member, estimated)


def with_pitches_of_fold(
    prepared: Prepared,
    found: Search,
    table: ResidualTable,
    split: Split,
    cut: CutCandidates,
    library: EffectLibrary,
) -> tuple[Prepared, CutCandidates]:
    """What a fold found with each periodic error at the pitch that fits what is kept the best; and
    its candidates with those on the whole `table`.
    """
    whole, weights = dict(cut.whole), dict(cut.weights)

    def member(candidate: Candidate, seen: Periodic, pitch: float) -> Member | None:
        waves = waves_of(table, library, candidate, seen.member)
        if waves is None:
            return None
        own = replace(candidate, members=(_member(table, candidate, waves, pitch, seen.member),))
        one = cut_candidates([own], split.kept, split.dimension)
        whole.update(one.whole)
        # It stands for all that the value of the grid stood for.
        known = weights[identity(candidate.name, seen.member)]
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
    member: Callable[[Candidate, Periodic, float], Member | None],
    estimated: Callable[[Prepared], Added],
) -> Described:
    """One wave after the other; `member` is that of a pitch, None where the data has none."""
    steps = [step for step in told.found.steps if step.member >= 0]
    for place, step in enumerate(steps):
        seen = periodic(told, step, library)
        # Of a wave that shows one phase no pitch is told: a hidden one would fit it better.
        if seen is None or len(seen.member.columns) < len(seen.waves.bound.parameters()):
            continue
        apart = _apart(told.prepared.candidates[step.index], seen.found)
        pitch = best_near(told, seen, place, apart)
        if pitch == seen.found:
            continue
        own = member(told.prepared.candidates[step.index], seen, pitch)
        prepared = None if own is None else _with(told.prepared, step, own)
        if prepared is not None:
            told = replace(told, prepared=prepared, effects=estimated(prepared))
    return told


def _member(
    table: ResidualTable, candidate: Candidate, waves: Waves, pitch: float, found: Member
) -> Member:
    """The member of a pitch with the parameters of the one found, less the polynomial."""
    member = waves.member(pitch, {name for name, _ in found.parameters})
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
