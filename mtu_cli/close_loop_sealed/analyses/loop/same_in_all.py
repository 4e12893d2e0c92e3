"""What is the same in all parts beside an effect that varies from part to part.

A growth from 20 degC is a scale at the mean temperature, too. The data tell its size twice, by
what varies from part to part and by what is the same in all of them. A scale of its own is in the
latter alone, where the growth hides it. That it is there is told by t = s / u(s), s its coefficient
beside the growth and all else that was found; t is of Student's distribution (degrees of freedom
by Welch). It is not tested among all candidates, but as what an effect that was found asks for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from mtu_cli.close_loop_sealed.analyses.loop.causes import causes
from mtu_cli.close_loop_sealed.analyses.loop.jointly import jointly
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import (
    ALIAS,
    NEARLY,
    hides,
    is_same,
    likeness,
    same_of,
    whitened_column,
)
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.state import Step, where_it_counts
from mtu_cli.close_loop_sealed.stats.column_groups import Column, MemberColumns
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.close_loop_sealed.stats.profile_ratio import unit_information
from mtu_cli.stats.least_squares import FloatArray, beside

DISAGREES = 0.01
"""p below which what is the same in all parts is taken to have an effect of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Constant:
    """The candidate `index` and its `member` that coefficient `of` of all that was found has in it:
    its `value` and `u` beside that, with `dof` degrees of freedom, and what all coefficients are
    then (`beta`, with `covariance`, and that with the value `together`). `hidden`: what was found
    takes up all that tells it.
    """

    of: int
    index: int
    member: int
    value: float
    u: float
    dof: float
    beta: FloatArray
    covariance: FloatArray
    together: FloatArray
    hidden: bool = False

    @property
    def t(self) -> float:
        """Of Student's distribution with `dof` degrees of freedom if `value` is 0 in truth."""
        return self.value / self.u

    @property
    def p(self) -> float:
        """Two-sided."""
        return float(2 * stdtr(self.dof, -abs(self.t)))


def with_constants(
    prepared: Prepared,
    gate: Gate,
    steps: Sequence[Step],
    alpha: float,
    most: int,
    unsure: frozenset[int] = frozenset(),
) -> tuple[list[Step], bool]:
    """The steps with what is the same in all parts beside them, the surest first; and whether more
    of it is there than causes were asked for (`most`). What was found in two forms that differ in
    just that is one effect with a constant.
    """
    found = _in_one_form(prepared, steps, unsure)
    while True:
        step = _surest(prepared, gate, found, alpha, unsure)
        if step is None:
            return found, False
        if causes(prepared, [*found, step]) > most:
            return found, True
        found.append(step)


def _in_one_form(prepared: Prepared, steps: Sequence[Step], unsure: frozenset[int]) -> list[Step]:
    """The steps without the second of two forms of one candidate that vary alike from part to part:
    a growth from 20 degC beside one from the mean of the day is a growth and a scale.

    Where the first is the same in no part (it is counted from the mean of the data) nothing else
    would tell that scale: it takes the place of the second. The second stays where none of the
    candidates, less those that are `unsure`, is what it is the same in.
    """
    scan, flat = prepared.scan, prepared.scan.flat()
    every = [column for step in steps if step.member >= 0 for column in flat[step.member]]
    known = {told.index for told in steps}
    found: list[Step] = []
    for step in steps:
        first = _alike(prepared, step, found)
        forms = [] if first is None else [flat[step.member][0], first]
        own = next(filter(None, (_most_of(scan, form) for form in forms)), None)
        if first is None or own is None or own.index in unsure:
            found.append(step)
        elif not same_of(scan, first) and own.index not in known and not own.is_told(scan, every):
            index = own.index
            found.append(
                replace(step, index=index, member=own.member, credible=(index,), constant=True)
            )
    return found


def _alike(prepared: Prepared, step: Step, found: Sequence[Step]) -> Column | None:
    """The column of the first effect found that is another form of a step."""
    scan, flat = prepared.scan, prepared.scan.flat()
    if step.member < 0 or len(flat[step.member]) != 1:
        return None
    forms = (flat[own.member] for own in found if own.index == step.index)
    return next(
        (
            own[0]
            for own in forms
            if len(own) == 1 and vary_alike(scan, own[0], flat[step.member][0])
        ),
        None,
    )


def vary_alike(scan: Scan, one: Column, other: Column) -> bool:
    """Whether two columns do the same from part to part, but for their size."""
    a, b = (
        {index: values for index, values in own.items() if index not in same}
        for own, same in ((one, same_of(scan, one)), (other, same_of(scan, other)))
    )
    return bool(a) and likeness(scan, a, b) >= 1 - NEARLY


def _surest(
    prepared: Prepared, gate: Gate, steps: Sequence[Step], alpha: float, unsure: frozenset[int]
) -> Step | None:
    """The surest constant that an effect found hides, of which p is below `DISAGREES` and `alpha`:
    that effect cannot be told without it. Its family-wise p is that of all tests, and may well be
    above alpha. Of one that is not hidden this has to be below: all tests looked for it.
    """
    members = [own.member for own in steps if own.member >= 0]
    known = unsure | {own.index for own in steps}
    best = None
    for own in constants(prepared, members):
        family = float(gate.family_p(np.array([-np.log(max(own.p, 1e-300))]))[0])
        passes = own.p < min(DISAGREES, alpha) if own.hidden else family < alpha
        if passes and own.index not in known and (best is None or own.p < best[0].p):
            best = own, family
    if best is None:
        return None
    own, family = best
    ratio = own.dof * np.log1p(own.t**2 / own.dof)
    return Step(
        index=own.index,
        member=own.member,
        p=family,
        log_bayes=float(unit_information(ratio, own.dof + 1, 1)),
        posterior=1.0,
        credible=(own.index,),
        constant=True,
    )


def constants(prepared: Prepared, members: Sequence[int]) -> Iterator[Constant]:
    """Candidates that are the same in all parts and lie in the effects found (`members`)."""
    scan, columns = prepared.scan, prepared.whole(members)
    flat = [column for member in columns for column in member]
    within = [(of, _most_of(scan, column)) for of, column in enumerate(flat)]
    told = [(of, own) for of, own in within if own is not None and not own.is_told(scan, flat)]
    if not told:
        return
    left, fit = jointly(prepared, whole_with_tangents(prepared, members))
    for of, own in told:
        counts = where_it_counts(left.scan, flat[of], fit.weights)
        found = beside_all(prepared, members, of, own.index, own.member)
        if found is not None:
            yield replace(found, hidden=bool(same_of(scan, counts)))


def whole_with_tangents(prepared: Prepared, members: Sequence[int]) -> list[MemberColumns]:
    """The whole coordinates of effects found, then their derivatives by what was searched."""
    tangents = [prepared.tangents[m] for m in members if m in prepared.tangents]
    return [*prepared.whole(members), *tangents]


def beside_all(
    prepared: Prepared, members: Sequence[int], of: int, index: int, member: int
) -> Constant | None:
    """A `member` of one column of the candidate `index` beside all effects found (`members`), with
    what coefficient `of` is then; None where nothing is left to tell it by.
    """
    whole = whole_with_tangents(prepared, members)
    _, apart = jointly(prepared, [*whole, *prepared.whole([member])])
    u = float(np.sqrt(max(apart.covariance[-1, -1], 0.0)))
    if u == 0:
        return None
    k = sum(len(prepared.members[m].columns) for m in members)
    return Constant(
        of=of,
        index=index,
        member=member,
        value=float(apart.beta[-1]),
        u=u,
        dof=max(float(apart.dof[-1]), 1.0),
        beta=apart.beta[:k],
        covariance=apart.covariance[:k, :k],
        together=apart.covariance[:k, -1],
    )


@dataclass(frozen=True, slots=True)
class _Within:
    """The candidate `index`, its `member` and its one `column`."""

    index: int
    member: int
    column: Column

    def is_told(self, scan: Scan, found: Sequence[Column]) -> bool:
        """Whether effects found that are the same in all parts, or the readings' own polynomial,
        make it already.
        """
        column = self.column
        known = [*found, *(own for member in scan.base for own in member)]
        alone = [own for own in known if is_same(scan, own) and not own.keys() - column.keys()]
        rows = np.stack([whitened_column(scan, own, [*column]) for own in (*alone, column)], axis=1)
        rows /= np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        return bool(beside(rows, len(alone))[0, 0] ** 2 <= ALIAS)


def _most_of(scan: Scan, column: Column) -> _Within | None:
    """The candidate that is the same in all parts and that a column, which it hides in, has most
    of: the first of exact aliases.
    """
    best, most = None, 0.0
    for index, m, member in scan.walk():
        if len(member) == 1 and is_same(scan, member[0]) and hides(scan, column, member[0]):
            like = likeness(scan, same_of(scan, column), member[0])
            if like > most + ALIAS:
                best, most = _Within(index, m, member[0]), like
    return best
