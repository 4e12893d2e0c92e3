"""Which rows of a table stand out, with family-wise control, whatever the columns' correlation.

Rotation test (Langsrud, Statistics and Computing 15 (2005) 53): rows that are independent
draws from one normal distribution, with any covariance between the columns, keep their joint
distribution when the centred table is multiplied by a random orthogonal matrix. The largest
of any statistics over all rows and columns can so be referred to its own distribution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

ROTATIONS = 999


@dataclass(frozen=True, slots=True, kw_only=True)
class Outstanding:
    """Family-wise p values, each adjusted for all rows, columns, groups and kinds.

    `by_row` (rows,) the smallest for the row as a whole (its distance and its mean over the
    columns of each group), `by_cell` (rows, columns) for single entries. `row_kind` tells
    which statistic of the row was smallest: 0 distance, 1 mean.
    """

    by_row: FloatArray
    by_cell: FloatArray
    row_kind: NDArray[np.int64]


def outstanding_rows(
    table: FloatArray, groups: NDArray[np.int64], seed: int, rotations: int = ROTATIONS
) -> Outstanding:
    """Rows that stand out of `table` (rows, columns), nan where an entry is missing.

    Three kinds of statistics share the error rate: single entries |d_ij|/s_j, the distance
    sum_j d_ij^2/s_j^2 and the mean |sum_j d_ij/s_j| over the columns of a group (an axis of an
    operation, say), d the deviation from the column's mean and s its sample deviation. Missing
    entries count as 0; rows of unequal repeats should be scaled to equal variance before.
    """
    d = _scaled(table)
    rows, _ = d.shape
    indicator = (groups[:, None] == np.unique(groups)[None, :]).astype(np.float64)
    observed = _statistics(d, indicator)
    basis = _complement_of_ones(rows)
    core = basis.T @ d
    rng = np.random.default_rng(seed)
    largest = np.empty((rotations, 3))
    for b in range(rotations):
        Q = np.linalg.qr(rng.standard_normal((rows - 1, rows - 1)))[0]
        largest[b] = [item.max() for item in _statistics(basis @ (Q @ core), indicator)]
    p = [_tail(item, largest[:, kind]) for kind, item in enumerate(observed)]
    # The three kinds are tested side by side: the smallest p of a table under the null is
    # itself referred to its distribution.
    own = np.array([_tail(largest[:, kind], largest[:, kind]) for kind in range(3)])
    smallest = own.min(axis=0)
    adjusted = [_lower_tail(item, smallest) for item in p]
    rowwise = np.stack([adjusted[1].min(axis=1), adjusted[2].min(axis=1)])
    return Outstanding(
        by_row=rowwise.min(axis=0), by_cell=adjusted[0], row_kind=np.argmin(rowwise, axis=0)
    )


def _scaled(table: FloatArray) -> FloatArray:
    known = np.isfinite(table)
    count = known.sum(axis=0)
    mean = np.where(known, table, 0.0).sum(axis=0) / np.maximum(count, 1)
    d = np.where(known, table - mean, 0.0)
    s = np.sqrt((d**2).sum(axis=0) / np.maximum(count - 1, 1))
    scaled: FloatArray = d / np.where(s > 0, s, 1.0)
    return scaled


def _statistics(d: FloatArray, indicator: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return np.abs(d), (d**2) @ indicator, np.abs(d @ indicator) / np.sqrt(indicator.sum(axis=0))


def _complement_of_ones(rows: int) -> FloatArray:
    """Orthonormal basis (rows, rows - 1) of what is orthogonal to a column of ones."""
    start = np.column_stack([np.ones(rows), np.eye(rows)[:, : rows - 1]])
    basis: FloatArray = np.linalg.qr(start)[0][:, 1:]
    return basis


def _tail(values: FloatArray, null: FloatArray) -> FloatArray:
    """(1 + number of null values at least as large)/(1 + their count), for every value."""
    ordered = np.sort(null)
    # Equal up to rounding counts as equal, so that a table is never rarer than itself.
    below = np.searchsorted(ordered, values * (1 - 1e-12), side="left")
    tail: FloatArray = (1 + len(null) - below) / (1 + len(null))
    return tail


def _lower_tail(values: FloatArray, null: FloatArray) -> FloatArray:
    """(1 + number of null values at most as large)/(1 + their count), for every value."""
    at_most = np.searchsorted(np.sort(null), values * (1 + 1e-12), side="right")
    tail: FloatArray = (1 + at_most) / (1 + len(null))
    return tail
