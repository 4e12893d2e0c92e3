"""One cause in two forms that differ by another.

Wear from the new tool on and wear from the middle of the data differ by lost motion that is there
all the time. Who finds both has found wear and lost motion; who finds one of them has the size of
the wear only if that one is the true form, and there is no lost motion beside it. What two forms
differ by that is the same in all parts, as a scale is of two growths, is looked for elsewhere (see
`same_in_all`): it stands in strata of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import ALIAS, is_same, whitened_column
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_candidate import Member
from mtu_cli.close_loop_sealed.stats.column_groups import Column
from mtu_cli.stats.least_squares import beside


def in_two_names(
    prepared: Prepared, steps: Sequence[Step], out: Collection[int] = ()
) -> list[Step]:
    """The steps with what two forms of one candidate differ by in place of the second one; as they
    are where no candidate is that, or one that was found as well, or is among the candidates `out`.
    """
    known = {own.index for own in steps} | {*out}
    found: list[Step] = []
    for step in steps:
        firsts = [own.member for own in found if step.member in _other_forms(prepared, own)]
        others = (difference(prepared, first, step.member) for first in firsts)
        index, member = next(filter(None, others), (step.index, step.member))
        if index not in known:
            step = replace(step, index=index, member=member, credible=(index,))
            known.add(index)
        found.append(step)
    return found


def hidden_in(prepared: Prepared, step: Step) -> tuple[int, int] | None:
    """The candidate, with its member, that a step and another form of it differ by."""
    others = (difference(prepared, step.member, m) for m in _other_forms(prepared, step))
    return next(filter(None, others), None)


def _other_forms(prepared: Prepared, step: Step) -> Iterator[int]:
    """Members of the same candidate, with one column, that nothing searched or chosen tells from
    that of a step.
    """
    own = None if step.member < 0 else _plain(prepared, step.member)
    for index, m, _ in prepared.scan.walk():
        if index == step.index and m != step.member and own is not None:
            other = _plain(prepared, m)
            if other is not None and other.covariate == own.covariate:
                yield m


def _plain(prepared: Prepared, m: int) -> Member | None:
    """A member of one column of which nothing was searched or chosen."""
    own = prepared.members[m]
    return None if own.searched or own.chosen or len(own.columns) > 1 else own


def difference(prepared: Prepared, one: int, other: int) -> tuple[int, int] | None:
    """The first candidate, with its member of one column, that lies in two members' span, and that
    is not the same in all parts; None without one.
    """
    scan, flat = prepared.scan, prepared.scan.flat()
    owners = scan.owners()
    (first,), (second,) = flat[one], flat[other]
    for index, m, columns in scan.walk():
        if index == owners[one] or len(columns) != 1 or is_same(scan, columns[0]):
            continue
        # A copy of one of them lies in the span as well, and is that form under another name.
        copies = any(_spanned(prepared, (own,), columns[0]) for own in (first, second))
        if not copies and _spanned(prepared, (first, second), columns[0]):
            return index, m
    return None


def _spanned(prepared: Prepared, by: Sequence[Column], column: Column) -> bool:
    """Whether columns leave nothing of another."""
    strata = sorted({index for own in (*by, column) for index in own})
    rows = np.stack([whitened_column(prepared.scan, own, strata) for own in (*by, column)], axis=1)
    rows /= np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    return bool(beside(rows, len(by))[0, 0] ** 2 <= ALIAS)
