"""What of a column is the same in all parts, and whether two columns are the same there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.close_loop.scan import Scan
from mtu_cli.stats.column_groups import Column, whiten
from mtu_cli.stats.least_squares import FloatArray

ALIAS = 1e-6
"""Share of a column's square that others leave of it if they are the same."""
SAME = ("column", "reversal")
"""The strata of what is the same in all parts."""


def same_of(scan: Scan, column: Column) -> Column:
    """The part of a column that is the same in all parts."""
    strata = scan.frame.strata.all
    return {index: values for index, values in column.items() if strata[index].kind in SAME}


def is_same(scan: Scan, column: Column) -> bool:
    """Whether all of a column is the same in all parts."""
    return len(same_of(scan, column)) == len(column) > 0


def is_told_twice(scan: Scan, column: Column) -> bool:
    """Whether some of a column is the same in all parts, and some is not."""
    return 0 < len(same_of(scan, column)) < len(column)


def alike(scan: Scan, one: Column, other: Column) -> bool:
    """Whether two columns are the same but for their size."""
    a, b = (whitened_column(scan, own, [*{**one, **other}]) for own in (one, other))
    size = float(a @ a) * float(b @ b)
    return size > 0 and float(a @ b) ** 2 >= (1 - ALIAS) * size


def whitened_column(scan: Scan, column: Column, strata: Sequence[int]) -> FloatArray:
    """The whitened coordinates of a column in these strata, end to end; 0 where it has none."""
    found = []
    for index in strata:
        own = (
            column[index].copy() if index in column else np.zeros(scan.frame.strata.all[index].size)
        )
        whiten(scan.frame.strata, scan.whitening, index, own)
        found.append(own)
    return np.concatenate(found)
