"""What is the same in all parts beside an effect that varies from part to part.

A growth from 20 degC is a scale at the mean temperature, too. The data tell its size twice, by
what varies from part to part and by what is the same in all of them. A scale of its own is in the
latter alone, where what was found hides it. What is the same in all parts needs another size than
the rest by t = s / u(s): s the coefficient of the growth's column there alone, estimated beside
the growth itself and all else that was found; t is of Student's distribution (degrees of freedom
by Welch).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from mtu_cli.analyses.close_loop.jointly import jointly
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.same_strata import (
    ALIAS,
    alike,
    is_same,
    is_told_twice,
    same_of,
    whitened_column,
)
from mtu_cli.analyses.close_loop.scan import Scan
from mtu_cli.analyses.close_loop.state import Step, where_it_counts
from mtu_cli.stats.column_groups import Column, MemberColumns
from mtu_cli.stats.family_gate import Gate
from mtu_cli.stats.least_squares import FloatArray, beside
from mtu_cli.stats.profile_ratio import unit_information
from mtu_cli.stats.stratified import StratifiedFit

DISAGREES = 0.01
"""p below which what is the same in all parts is taken to have an effect of its own."""
NONE: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """Of coefficient `index` of all that was found the `column` in what is the same in all parts,
    and by how much that disagrees: `t` with `dof` degrees of freedom. All coefficients are `moved`
    (k,) by it; `hidden` whether the column hides other effects there.
    """

    index: int
    column: Column
    t: float
    dof: float
    moved: FloatArray
    hidden: bool

    @property
    def p(self) -> float:
        return float(2 * stdtr(self.dof, -abs(self.t)))


def with_constants(
    prepared: Prepared, gate: Gate, steps: Sequence[Step], unsure: frozenset[int] = NONE
) -> list[Step]:
    """The steps with one more for each effect of which what is the same in all parts needs another
    size than what varies (p below `DISAGREES`): of the first candidate that is just that, if there
    is one. Its family-wise p is that of all tests; it may well be above their rate, as the effect
    beside it cannot be told without it.
    """
    found = list(steps)
    for step in [own for own in steps if own.member >= 0]:
        members = [own.member for own in found if own.member >= 0]
        for own in disagreements(prepared, prepared.whole(members), members):
            if own.index not in _coefficients(prepared, members, step.member):
                continue
            taken = unsure | {one.index for one in found}
            index, member = _candidate(prepared, own.column, taken)
            if own.p >= DISAGREES or index is None or not own.hidden:
                continue
            p = gate.family_p(np.array([-np.log(max(own.p, 1e-300))]))
            ratio = own.dof * np.log1p(own.t**2 / own.dof)
            found.append(
                Step(
                    index=index,
                    member=member,
                    p=float(p[0]),
                    log_bayes=float(unit_information(ratio, own.dof + 1, 1)),
                    posterior=1.0,
                    credible=(index,),
                    constant=True,
                )
            )
            break
    return found


def with_disagreement(
    prepared: Prepared, columns: Sequence[MemberColumns], members: Sequence[int], fit: StratifiedFit
) -> StratifiedFit:
    """The fit whose covariance holds how far both sizes are apart: d d' is added to it, where
    d = beta - beta', and beta' is estimated with a size of its own for what is the same in all
    parts. That there is none is not known: by d the coefficients are off if there is one.
    """
    moved = [own.moved for own in disagreements(prepared, columns, members)]
    more = sum((np.outer(d, d) for d in moved), np.zeros_like(fit.covariance))
    return replace(fit, covariance=fit.covariance + more)


def _coefficients(prepared: Prepared, members: Sequence[int], member: int) -> range:
    """Indices of a member's coefficients among those of all members."""
    sizes = [len(prepared.members[m].columns) for m in members]
    place = members.index(member)
    return range(sum(sizes[:place]), sum(sizes[: place + 1]))


def disagreements(
    prepared: Prepared, columns: Sequence[MemberColumns], members: Sequence[int]
) -> Iterator[Disagreement]:
    """Of each coefficient that is told twice."""
    scan, flat = prepared.scan, [column for member in columns for column in member]
    twice = [i for i, column in enumerate(flat) if is_told_twice(scan, column)]
    if not twice:
        return
    whole = [*columns, *(prepared.tangents[m] for m in members if m in prepared.tangents)]
    left, fit = jointly(prepared, whole)
    for index in twice:
        same = same_of(scan, flat[index])
        if _in_others(scan, same, flat):
            continue
        _, apart = jointly(prepared, [*whole, (same,)])
        u = float(np.sqrt(max(apart.covariance[-1, -1], 0.0)))
        if u == 0:
            continue
        counts = where_it_counts(left.scan, flat[index], fit.weights)
        yield Disagreement(
            index=index,
            column=same,
            t=float(apart.beta[-1]) / u,
            dof=max(float(apart.dof[-1]), 1.0),
            moved=(fit.beta - apart.beta[:-1])[: len(flat)],
            hidden=not set(same).isdisjoint(counts),
        )


def _in_others(scan: Scan, same: Column, found: Sequence[Column]) -> bool:
    """Whether effects found that are the same in all parts, or the readings' own polynomial, make
    that already.
    """
    known = [*found, *(own for member in scan.base for own in member)]
    alone = [own for own in known if is_same(scan, own) and not own.keys() - same.keys()]
    rows = np.stack([whitened_column(scan, own, [*same]) for own in (*alone, same)], axis=1)
    rows /= np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    return bool(beside(rows, len(alone))[0, 0] ** 2 <= ALIAS)


def _candidate(
    prepared: Prepared, column: Column, taken: frozenset[int] | set[int]
) -> tuple[int | None, int]:
    """The first candidate, none of `taken`, of which a member is the column alone; that member."""
    scan = prepared.scan
    first = 0
    for index, members in enumerate(scan.columns):
        for m, member in enumerate(members, first):
            if index not in taken and len(member) == 1 and alike(scan, column, member[0]):
                return index, m
        first += len(members)
    return None, -1
