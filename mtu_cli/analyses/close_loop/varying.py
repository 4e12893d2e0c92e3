"""What varies from part to part, and an effect that is the same in all of them may be on the mean.

Where all parts were made at nearly one temperature far from 20 degC, a scale was found, and a
growth is not told by what varies: the scale is that of these days. The same estimate as in
`same_in_all`, seen from its other side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.same_in_all import Constant, beside_all, vary_alike
from mtu_cli.analyses.close_loop.same_strata import hides, is_same, same_of
from mtu_cli.analyses.close_loop.scan import Scan
from mtu_cli.stats.column_groups import Column


def varying(prepared: Prepared, members: Sequence[int]) -> Iterator[Constant]:
    """For each coefficient of the effects found (`members`) that is the same in all parts, the
    candidate that hides it and is the surest beside it: its value, and what all others are then.
    """
    scan = prepared.scan
    flat = [column for member in prepared.whole(members) for column in member]
    for of, column in enumerate(flat):
        if not is_same(scan, column):
            continue
        beside = []
        for index, m, member in scan.walk():
            one = len(member) == 1 and not prepared.members[m].searched
            if not one or not (_mostly_same(scan, member[0]) and hides(scan, member[0], column)):
                continue
            if not any(vary_alike(scan, member[0], own) for own in flat):
                own = beside_all(prepared, members, of, index, m)
                beside += [] if own is None else [own]
        if beside:
            yield min(beside, key=lambda own: own.p)


def _mostly_same(scan: Scan, column: Column) -> bool:
    """Whether more of a column is the same in all parts than varies: the mean temperature is
    farther from where a growth is 0 than parts are from one another.
    """
    same = same_of(scan, column)
    squares = {index: float(values @ values) for index, values in column.items()}
    return 2 * sum(squares[index] for index in same) > sum(squares.values())
