"""What of a column is the same in all parts, and how far two columns are the same there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.stats.column_groups import Column, whiten
from mtu_cli.stats.least_squares import FloatArray

ALIAS = 1e-6
"""Share of a column's square that others leave of it if they say the same."""
NEARLY = 0.2
"""The same from which on one column hides another: what is left tells too little of it."""
SAME = ("column", "reversal")
"""The strata of what is the same in all parts."""


def same_of(scan: Scan, column: Column) -> Column:
    """The part of a column that is the same in all parts."""
    strata = scan.frame.strata.all
    return {index: values for index, values in column.items() if strata[index].kind in SAME}


def is_same(scan: Scan, column: Column) -> bool:
    """Whether all of a column is the same in all parts."""
    return len(same_of(scan, column)) == len(column) > 0


def likeness(scan: Scan, one: Column, other: Column) -> float:
    """The share of either column's square that is the other but for its size."""
    a, b = (whitened_column(scan, own, [*{**one, **other}]) for own in (one, other))
    size = float(a @ a) * float(b @ b)
    return float(a @ b) ** 2 / size if size > 0 else 0.0


def hides(scan: Scan, column: Column, other: Column) -> bool:
    """Whether a column that is told twice hides `other`, which is the same in all parts."""
    same = same_of(scan, column)
    told_twice = 0 < len(same) < len(column)
    return told_twice and likeness(scan, same, other) >= 1 - NEARLY


def whitened_column(scan: Scan, column: Column, strata: Sequence[int]) -> FloatArray:
    """The whitened coordinates of a column in these strata, end to end; 0 where it has none."""
    found = []
    for index in strata:
        size = scan.frame.strata.all[index].size
        own = column[index].copy() if index in column else np.zeros(size)
        whiten(scan.frame.strata, scan.whitening, index, own)
        found.append(own)
    return np.concatenate(found)
