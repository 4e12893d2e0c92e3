"""The pitch of a periodic error between the values that were searched.

A grid of frequencies finds a wave; it lies up to an eighth of a period off at the ends of the data,
which is no estimate. The profile of the least squares over all frequencies about it has one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.close_loop.added import added
from mtu_cli.analyses.close_loop.describe import Described
from mtu_cli.analyses.close_loop.fitted import beside_polynomial
from mtu_cli.analyses.close_loop.folds import CutCandidates, cut_candidates, identity
from mtu_cli.analyses.close_loop.other_pitches import Periodic, best_near, periodic
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.model.effect_library import Candidate, EffectLibrary, Member
from mtu_cli.model.effect_search import Waves, waves_of
from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.loop_frame import grouped


def with_refined_pitches(
    told: Described, library: EffectLibrary, seed: int, owners: Mapping[int, int]
) -> Described:
    """The same with each periodic error at the pitch that fits best beside all other effects."""
    place = 0
    for step in told.found.steps:
        if step.member < 0:
            continue
        seen = periodic(told, step, library)
        own = None if seen is None else _best(told, step, seen, place)
        prepared = None if own is None else _with(told.prepared, step, own)
        if prepared is not None:
            effects = added(prepared, told.found, seed, owners=owners)
            told = replace(told, prepared=prepared, effects=effects)
        place += 1
    return told


def with_pitches_of_fold(
    prepared: Prepared, found: Search, whole: Whole, library: EffectLibrary
) -> tuple[Prepared, CutCandidates]:
    """What a fold found with each periodic error at the pitch that fits what is kept the best; and
    its candidates with those on the `whole` table.
    """
    cut = whole.cut
    told = Described(
        prepared=prepared, found=found, effects=added(prepared, found, rough=True), chosen=()
    )
    place = 0
    for step in found.steps:
        if step.member < 0:
            continue
        seen = periodic(told, step, library)
        place += 1
        if seen is None:
            continue
        pitch = best_near(told, seen, place - 1, _apart(told.prepared, step, seen))
        candidate = told.prepared.candidates[step.index]
        waves = waves_of(whole.table, library, candidate, seen.member)
        if waves is None or pitch == seen.found:
            continue
        member = _member(whole.table, candidate, waves, pitch, seen.member)
        one = cut_candidates([replace(candidate, members=(member,))], whole.kept, whole.dimension)
        (kept,) = one.candidates
        other = _with(told.prepared, step, kept.members[0]) if kept.members else None
        if other is None:
            continue
        own = dict.fromkeys(one.whole, cut.weights[identity(candidate.name, seen.member)])
        cut = replace(cut, whole={**cut.whole, **one.whole}, weights={**cut.weights, **own})
        told = replace(told, prepared=other, effects=added(other, found, rough=True))
    return told.prepared, cut


@dataclass(frozen=True, kw_only=True)
class Whole:
    """The `table` that a fold keeps some of (`kept`, along a `dimension`), and its candidates."""

    table: ResidualTable
    cut: CutCandidates
    kept: NDArray[np.bool_]
    dimension: int


def _best(told: Described, step: Step, seen: Periodic, place: int) -> Member | None:
    """The member of the best pitch; None where the one found is as good."""
    prepared = told.prepared
    apart = _apart(prepared, step, seen)
    pitch = best_near(told, seen, place, apart)
    if pitch == seen.found:
        return None
    candidate = prepared.candidates[step.index]
    return _member(prepared.table, candidate, seen.waves, pitch, seen.member)


def _member(
    table: ResidualTable, candidate: Candidate, waves: Waves, pitch: float, found: Member
) -> Member:
    """The member of a pitch with the parameters of the one found, less the polynomial."""
    member = waves.member(pitch, {name for name, _ in found.parameters})
    (own,) = beside_polynomial(table, [replace(candidate, members=(member,))])
    return own.members[0]


def _apart(prepared: Prepared, step: Step, seen: Periodic) -> float:
    """From the frequency found to the farther one of those searched beside it, 1/mm."""
    own = [m for m in prepared.candidates[step.index].members if m.searched]
    known = np.unique([1.0 / value for m in own for value in m.searched.values()])
    at = int(np.argmin(np.abs(known - 1.0 / seen.found)))
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
