"""Which rows of a table stand out, with family-wise control, whatever the columns' correlation.

Rotation test (Langsrud, Statistics and Computing 15 (2005) 53): rows that are independent
draws from one normal distribution, with any covariance between the columns, keep their joint
distribution when the centred table is multiplied by a random orthogonal matrix. The largest
of any statistics over all rows and columns can so be referred to its own distribution. The
same holds for the elements of any subgroup: sign changes of the rows' cosine transform rotate
large tables quickly.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.outliers import deviation_p
from mtu_cli.stats.resolution import hidden

ROTATIONS = 999
ENTRIES = 100_000
"""Tables with more entries are tested by bounds, single entries and means alone."""
MOST_THREADS = 4
DENSE_ROWS = 64
"""Up to so many rows the rotations are uniform on the whole orthogonal group."""

IN_CACHE = 250_000
"""Numbers rotated at a time: what stays in the processor's cache."""

Rotate = Callable[[int], FloatArray]
"""So many rotated tables (n, rows, columns)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outstanding:
    """Family-wise p values, each adjusted for all rows, columns, groups and kinds: `by_row` (rows,)
    the smallest for the row as a whole (its distance and its mean over the columns of each group),
    `by_cell` (rows, columns) for single entries.
    """

    by_row: FloatArray
    by_cell: FloatArray


def outstanding_rows(
    table: FloatArray,
    groups: IntArray,
    seed: int,
    rounding: FloatArray | float = 0.0,
) -> Outstanding:
    """Rows that stand out of `table` (rows, columns), nan where an entry is missing.

    Three kinds of statistics share the error rate: single entries |d_ij|/s_j, the distance
    sum_j d_ij^2/s_j^2 over the columns of a group (an axis of an operation, say) and over all
    of them, and the mean |sum_j d_ij/s_j| over those of a group; d is the deviation from the
    column's mean, s its sample deviation. Missing entries count as 0, which errs on the safe
    side; rows of unequal repeats should be scaled to equal variance before. `rounding` (columns,)
    is the variance that the last digit hides from entries that are alike (`resolution.hidden`).
    """
    finite = np.isfinite(table)
    count = finite.sum(axis=0).astype(np.float64)
    mean = np.where(finite, table, 0.0).sum(axis=0) / np.maximum(count, 1)
    d = np.where(finite, table - mean, 0.0)
    s2 = np.einsum("ij,ij->j", d, d) / np.maximum(count - 1, 1)
    s = np.sqrt(s2 + hidden(s2, rounding))
    d /= np.where(s > 0, s, 1.0)
    indicator = (groups[:, None] == np.unique(groups)[None, :]).astype(np.float64)
    if d.size <= ENTRIES:
        return _by_rotation(d, indicator, np.random.default_rng(seed))
    return _by_bounds(d, count, indicator)


def _by_rotation(d: FloatArray, indicator: FloatArray, rng: np.random.Generator) -> Outstanding:
    observed = _statistics(d, indicator)
    # What is rotated: columns with missing entries, or that the last digit makes too small, are
    # stretched to the variance of the others.
    squares = np.einsum("ij,ij->j", d, d)
    filled = d * np.sqrt((len(d) - 1) / np.where(squares > 0, squares, np.inf))
    rotate = _rotations(filled, rng)
    largest: list[list[FloatArray]] = [[], [], []]
    square = len(d) ** 2 if len(d) <= DENSE_ROWS else 0
    batch = max(1, IN_CACHE // max(d.size, square, 1))
    for start in range(0, ROTATIONS, batch):
        tables = rotate(min(batch, ROTATIONS - start))
        for maxima, item in zip(largest, _statistics(tables, indicator), strict=True):
            maxima.append(item.max(axis=1))
    # Entries are alike in all columns, the others differ in size from group to group.
    nulls: list[FloatArray] = [np.concatenate(largest[0]).max(axis=1)]
    values = [observed[0]]
    for kind in (1, 2):
        value, null = _alike(observed[kind], np.concatenate(largest[kind]))
        values.append(value)
        nulls.append(null)
    p = [_tail(value, null) for value, null in zip(values, nulls, strict=True)]
    # The three kinds are tested side by side: the smallest p of a table under the null is
    # itself referred to its distribution.
    tails = np.array([_tail(null, null) for null in nulls])
    smallest = tails.min(axis=0)
    entries, distance, mean = (_lower_tail(item, smallest) for item in p)
    by_row = np.minimum(distance.min(axis=1), mean.min(axis=1))
    return Outstanding(by_row=by_row, by_cell=entries)


def _by_bounds(d: FloatArray, count: FloatArray, indicator: FloatArray) -> Outstanding:
    """Large tables: half of the error rate each to single entries and means, by the bound of
    Bonferroni on Grubbs's statistic.
    """
    rows = len(d)
    entries = np.minimum(2 * d.size * deviation_p(d, count[None, :]), 1.0)
    means = d @ indicator
    scale = np.sqrt((means**2).sum(axis=0) / (rows - 1))
    means = means / np.where(scale > 0, scale, 1.0)
    mean = np.minimum(2 * means.size * deviation_p(means, np.full(1, float(rows))), 1.0)
    return Outstanding(by_row=mean.min(axis=1), by_cell=entries)


def _alike(observed: FloatArray, largest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Statistics (rows, groups) of groups of any size made comparable, and the null (rotations,) of
    the largest of them: in terms of the group's largest values, the observed one among them, which
    are exchangeable under the null.
    """
    pool = np.vstack([largest, observed.max(axis=0)])
    s = pool.std(axis=0)
    s = np.where(s > 0, s, 1.0)
    return (observed - pool.mean(axis=0)) / s, ((largest - pool.mean(axis=0)) / s).max(axis=1)


def _statistics(d: FloatArray, indicator: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The three kinds of statistics (..., rows, their number) of tables (..., rows, columns)."""
    groups = indicator
    if indicator.shape[1] > 1:  # all columns together, too
        groups = np.column_stack([indicator, np.ones(len(indicator))])
    return np.abs(d), (d**2) @ groups, np.abs(d @ indicator) / np.sqrt(indicator.sum(axis=0))


def _rotations(d: FloatArray, rng: np.random.Generator) -> Rotate:
    """Random rotations of the centred table `d` that leave the columns' means at 0."""
    rows = len(d)
    if rows > DENSE_ROWS:
        from scipy.fft import dct, idct

        core = dct(d, axis=0, norm="ortho")
        signs = np.array([-1, 1], d.dtype)
        threads = min(MOST_THREADS, os.cpu_count() or 1)

        def flip(n: int) -> FloatArray:
            return idct(
                core * rng.choice(signs, (n, rows, 1)), axis=1, norm="ortho", overwrite_x=True,
                workers=threads,
            )  # fmt: skip

        return flip
    # Orthonormal columns of what is orthogonal to ones.
    basis = np.linalg.qr(np.column_stack([np.ones(rows), np.eye(rows)[:, : rows - 1]]))[0][:, 1:]
    inner = basis.T @ d

    def rotate(n: int) -> FloatArray:
        Q, R = np.linalg.qr(rng.standard_normal((n, rows - 1, rows - 1)))
        # Uniform only with the signs of R's diagonal (Mezzadri, Notices AMS 54 (2007) 592).
        signs = np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None, :]
        return basis @ ((Q * signs) @ inner)

    return rotate


def _tail(values: FloatArray, null: FloatArray) -> FloatArray:
    """(1 + number of null values at least as large)/(1 + their count), for every value."""
    ordered = np.sort(null)
    # Equal up to rounding counts as equal, so that a table is never rarer than itself.
    below = np.searchsorted(ordered, values - 1e-12 * (1 + np.abs(values)), side="left")
    return (1 + len(null) - below) / (1 + len(null))


def _lower_tail(values: FloatArray, null: FloatArray) -> FloatArray:
    """(1 + number of null values at most as large)/(1 + their count), for every value."""
    at_most = np.searchsorted(np.sort(null), values * (1 + 1e-12), side="right")
    return (1 + at_most) / (1 + len(null))
