"""Effects that the data cannot tell apart, and how far apart further parts would set them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.follow_up import Wanted, as_it_is
from mtu_cli.close_loop_sealed.analyses.loop.further_parts import FollowUp
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.separation import (
    Seen,
    Sight,
    combined,
    has_new_tool,
    longer,
    member_columns,
    sight_of,
)
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column, Member
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, compact
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary, candidates
from mtu_cli.language import names, parse
from mtu_cli.stats.least_squares import FloatArray

NEAREST, FEW = 60, 12
"""Members of each rival that are fitted to a follow-up: those nearest to the effects now; few of
those known before where the library is asked again.
"""


@dataclass(frozen=True, slots=True)
class Separation:
    """`square` d^2 averaged over the posterior, and its `share` of z^2."""

    square: float
    share: float

    @property
    def d(self) -> float:
        """In standard deviations."""
        return float(np.sqrt(self.square))


class Rivalry:
    """A class of candidates (by index) with the best member, the coefficients and the posterior
    of each, beside other members that were found.
    """

    def __init__(
        self,
        prepared: Prepared,
        beta: Mapping[int, FloatArray],
        posterior: Mapping[int, float],
        members: Mapping[int, int],
        beside: tuple[int, ...],
        library: EffectLibrary,
    ) -> None:
        self.prepared, self.beta, self.beside = prepared, beta, beside
        self.members, self.families = dict(members), library
        self.weight = {i: posterior[i] for i in self.members}
        now = as_it_is(prepared.table)
        self.now = sight_of(prepared, now, self.beside)
        self.effects_now = self._effects(self.now, now)
        starts = np.cumsum([0, *(len(own) for own in prepared.scan.columns)])
        self.rivals = {
            i: self._nearest(i, prepared.members[int(starts[i]) : int(starts[i + 1])])
            for i in self.members
        }

    def candidates(self) -> list[Candidate]:
        """The class, the most probable first."""
        order = sorted(self.members, key=lambda i: -self.weight[i])
        return [self.prepared.candidates[i] for i in order]

    def wanted(self) -> Wanted:
        """What the class depends on."""
        used: set[str] = set()
        pitches: dict[str, float] = {}
        outlying: list[int] = []
        table = self.prepared.table
        for i in sorted(self.members, key=lambda i: -self.weight[i]):
            member = self._best(i)
            own = _names_of(member)
            used |= own
            for name, value in member.searched.items():
                if name.endswith("_mm"):
                    for axis in own & set(POSITIONS):
                        pitches.setdefault(axis, value)
            if member.chosen in table.parts and _is_of_parts(member, len(table.parts)):
                outlying.append(table.parts.index(member.chosen))
        return Wanted(
            used=used, pitches=pitches, outlying=outlying, travel=table.travel, read=table.read
        )

    def separation(self, plan: FollowUp) -> Separation:
        """d^2 = z^2 (1 - max R^2 over the rivals), averaged over which effect is the true one."""
        sight = sight_of(self.prepared, plan, self.beside) if plan.count else self.now
        effects = self._effects(sight, plan)
        z2 = sight.left(effects)
        d2 = dict(z2)
        again = self._anew(plan)
        for rival, ids in self.rivals.items():
            others = {i: e for i, e in effects.items() if i != rival}
            known = ids[:FEW] if rival in again else ids
            for columns in sight.members([*self._known(plan, known), *again.get(rival, ())]):
                for i, left in sight.left(others, columns).items():
                    d2[i] = min(d2[i], left)
        whole = sum(self.weight.values())
        square = sum(self.weight[i] * d2[i] for i in effects) / whole
        total = sum(self.weight[i] * z2[i] for i in effects) / whole
        return Separation(square, square / total if total > 0 else 0.0)

    def _best(self, index: int) -> Member:
        return self.prepared.members[self.members[index]]

    def _effects(self, sight: Sight, plan: FollowUp) -> dict[int, Seen]:
        found = {}
        for i in self.members:
            member = self._best(i)
            tool = has_new_tool(member, plan)
            columns = member_columns(member, self.prepared.table, plan, new_tool=tool)
            found[i] = combined(sight.columns(columns), self.beta[i])
        return found

    def _known(self, plan: FollowUp, members: Sequence[Member]) -> Iterator[tuple[Column, ...]]:
        """Columns of members; of a count that a new tool may begin again, both ways."""
        for member in members:
            for tool in (False, True) if has_new_tool(member, plan) else (False,):
                yield member_columns(member, self.prepared.table, plan, new_tool=tool)

    def _anew(self, plan: FollowUp) -> dict[int, list[tuple[Column, ...]]]:
        """Columns of the members that rivals have beside, once the further parts are there: a
        step with the first of them, short waves that the old places took for long ones.
        """
        moved = {name for name, value in plan.values.items() if len(value) > 1}
        own = {i: self.prepared.candidates[i] for i in self.members}
        wanted = {i: c for i, c in own.items() if _names_of(self._best(i)) & moved}
        if not plan.count or not wanted:
            return {}
        names_of = {c.family for c in wanted.values()}
        few = tuple(f for f in self.families.families if f.family.family in names_of)
        table = longer(self.prepared.table, plan)
        by_name = {c.name: c for c in candidates(table, replace(self.families, families=few))}
        return {
            i: [m.columns for m in self._nearest(i, by_name[c.name].members)]
            for i, c in wanted.items()
            if c.name in by_name
        }

    def _nearest(self, index: int, members: Sequence[Member]) -> list[Member]:
        """The best member of a candidate, and those that come nearest to the others' effects now.

        What is far from an effect now cannot come near it by further parts: generalised least
        squares leaves no less of more data.
        """
        others = {j: e for j, e in self.effects_now.items() if j != index}
        if not others:
            return list(members)
        parts = len(self.prepared.table.parts)
        whole = self.now.left(others)
        near = []
        for columns in self.now.members(_cut(m.columns, parts) for m in members):
            left = self.now.left(others, columns)
            near.append(min(left[j] / whole[j] if whole[j] > 0 else 0.0 for j in others))
        order = np.argsort(near, kind="stable")[:NEAREST]
        return [members[int(i)] for i in order]


def _cut(columns: Sequence[Column], parts: int) -> tuple[Column, ...]:
    """The levers of the first parts."""

    def cut(lever: FloatArray) -> FloatArray:
        return compact(lever[:parts]) if len(lever) > parts else lever

    return tuple({axis: cut(lever) for axis, lever in column.items()} for column in columns)


def _names_of(member: Member) -> set[str]:
    """Positions and covariates in a member's equations."""
    parameters = {name for name, _ in member.parameters}
    found = {name for text in member.equations.values() for name in names(parse(text))}
    return found - parameters


def _is_of_parts(member: Member, parts: int) -> bool:
    levers = [lever for column in member.columns for lever in column.values()]
    return not member.equations and parts > 1 and all(v.shape == (parts, 1) for v in levers)
