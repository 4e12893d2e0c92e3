"""Single values, and rows of a table, that are too far from the others, with family-wise control.

Rotation test (Langsrud, Statistics and Computing 15 (2005) 53): rows that are independent
draws from one normal distribution, with any covariance between the columns, keep their joint
distribution when the centred table is multiplied by a random orthogonal matrix. The largest
of any statistics over all rows and columns can so be referred to its own distribution. The
same holds for the elements of any subgroup: sign changes of the rows' cosine transform rotate
large tables quickly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit

from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray
from mtu_cli.stats.resolution import hidden
from mtu_cli.stats.threads import available_threads

FEWEST = 3
"""A deviation among fewer values than this says nothing."""
GROSS = 8.0
"""Standard deviations of the others from which on a value is no part of them."""
MOST = 0.2
"""Share of the readings beyond which they are another distribution, no outliers."""
NORMAL_MAD = 1.4826
LEAST_DOF = 0.1
"""Share of the degrees of freedom that medians leave at least."""


def deviation_p(d: FloatArray, count: FloatArray) -> FloatArray:
    """Two-sided p of deviations `d` = (value - mean)/s, s the sample's own deviation.

    `count` is the sample's size n. For normal values t = d sqrt(n (n - 2)/((n - 1)^2 - n d^2))
    has Student's t with n - 2 degrees of freedom (Grubbs, Technometrics 11 (1969) 1).
    """
    n = np.maximum(count, float(FEWEST))
    divisor = (n - 1) ** 2 - n * d**2
    with np.errstate(over="ignore"):
        t = np.abs(d) * np.sqrt(n * (n - 2) / np.maximum(divisor, np.finfo(np.float64).tiny))
    return np.where(count >= FEWEST, 2 * stdtr(n - 2, -t), 1.0)


SAMPLED = 100_000
"""Values that are enough for a median and a deviation to half a percent."""
OUTLYING_P = 1e-4
"""Chance that any value of a sound normal sample is beyond the limit of `outlying`."""
FACTOR = 2.0
"""Outliers are so many times farther off than all that are none."""
NEAR = 0.8
"""Share of the values, those near the median, that give s."""
NEAR_SQUARE, NEAR_EFFICIENCY = 0.4377245949036389, 0.6277679967579073
"""Mean square of the NEAR = q of normal values of variance 1 that are nearest to 0, and the share
of the degrees of freedom of s^2 that those count.

With P(|x| < k) = q and A = E x^2 [|x| < k] = q - 2 k f(k) these are A/q and
2 A^2/var(min(x^2, k^2)) by the influence function of A (Huber, Robust Statistics, 1981, 3.3), as
moving k takes k^2 from the density at the edge."""
MAD_EFFICIENCY = 0.37
"""Of a median absolute deviation as a deviation of normal values (Rousseeuw & Croux,
J. Am. Stat. Assoc. 88 (1993) 1273): so many of its degrees of freedom count."""


def medians(table: FloatArray, axis: int) -> FloatArray:
    """Medians of the finite values of a table along an axis, which stays; nan where none is.

    >>> medians(np.array([[1.0, np.nan], [2.0, 5.0], [4.0, 7.0]]), 0).tolist()
    [[2.0, 6.0]]
    """
    count = np.isfinite(table).sum(axis=axis, keepdims=True)
    if (count == table.shape[axis]).all():
        return np.median(table, axis=axis, keepdims=True)
    ordered = np.sort(table, axis=axis)  # nan last
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, table.shape[axis] - 1), axis)
    return (low + high) / 2


def median_polish(table: FloatArray, x: FloatArray | None = None) -> FloatArray:
    """A table (rows, columns) less the medians of its columns, of its rows, and of its columns
    again (the median polish of Tukey, 1977); of rows at `x` (columns,) also less their slope, the
    median of those of all pairs (Theil 1950, Sen 1968). Rows of FEWEST values or fewer keep their
    level.
    """
    rest = table - medians(table, 0)
    if x is not None and np.ptp(x) > 0:
        i, j = np.triu_indices(len(x), 1)
        i, j = i[x[j] > x[i]], j[x[j] > x[i]]
        rest = rest - medians((rest[:, j] - rest[:, i]) / (x[j] - x[i]), 1) * (x - np.median(x))
    several = np.isfinite(table).sum(axis=1, keepdims=True) > FEWEST
    rest = rest - np.where(several, medians(rest, 1), 0.0)
    return rest - medians(rest, 0)


def outlying(values: FloatArray, fitted: int = 0, r: float = 0.0) -> tuple[BoolArray, float]:
    """Outliers among values of any shape that are one sample, and its deviation s; nan is none.

    d is the distance from the median, s^2 = mean of the NEAR smallest d^2 / 0.4377 / (1 - g/n) of n
    values and g parameters, this median and those `fitted` before, with the variance `r` that a
    coarse display hides (`resolution.hidden`). An outlier is beyond GROSS s, beyond s times
    Student's t at OUTLYING_P/n (Bonferroni), and beyond FACTOR times the farthest of the rest: no
    tail of a distribution, nor the turn of a curve. More than a fifth are none.

    >>> values = np.append(np.sin(np.arange(30.0)), 40.0)
    >>> mask, s = outlying(values)
    >>> mask.nonzero()[0].tolist(), round(s, 2)
    ([30], 0.9)
    """
    result = np.zeros(values.shape, bool)
    usable = np.isfinite(values)
    finite = values[usable]
    n, dof = len(finite), len(finite) - fitted - 1
    if dof < FEWEST:
        return result, 0.0
    middle = np.median(finite[:: n // SAMPLED + 1])
    rest = np.abs(finite - middle)
    sample = rest[:: n // SAMPLED + 1]
    count = max(int(NEAR * len(sample)), 1)
    near = np.partition(sample, count - 1)[:count]
    s2 = float(np.mean(near**2)) / NEAR_SQUARE / max(dof / n, LEAST_DOF)
    s = math.sqrt(s2 + float(hidden(s2, r)))
    t = -float(stdtrit(max(NEAR_EFFICIENCY * dof, 1.0), OUTLYING_P / (2 * n)))
    beyond = rest > max(GROSS, t) * s
    tail = np.sort(rest[beyond])
    # The outermost gap that is wide enough parts the outliers from the rest.
    wide = tail > FACTOR * np.append(rest[~beyond].max(initial=0.0), tail[:-1])[: len(tail)]
    wide[: max(len(tail) - int(MOST * n), 0)] = False
    if wide.any():
        result[usable] = rest >= tail[wide][0]
    return result, s


def spikes(values: FloatArray, least: float = 0.0, r: float = 0.0) -> tuple[BoolArray, float]:
    """Outliers among evenly taken values (n,) of a curve that are off by `least` or more, and the
    deviation s, as `outlying`, with the variance `r` that a coarse display hides.

    A value is compared with the lines through the two before, the two after and those on both
    sides, and its smallest deviation counts: beside a kink one of them is sound. Those that are
    off farthest are taken out and the rest is judged again, as spikes hide beside each other; s
    is that of deviations from the mean of both neighbours. The ends are not judged;
    nan is skipped.

    >>> curve = np.exp(-np.arange(20.0) / 5) + 0.01 * np.cos(np.arange(20.0) ** 2)
    >>> curve[7] += 3
    >>> spikes(curve)[0].nonzero()[0].tolist()
    [7]
    """
    result, s, usable = np.zeros(len(values), bool), 0.0, np.isfinite(values)
    while len(rest := np.flatnonzero(usable & ~result)) >= 2 * FEWEST:
        x = values[rest]
        scatter = np.abs(x[1:-1] - (x[:-2] + x[2:]) / 2)
        n = len(scatter)
        s2 = (NORMAL_MAD * float(np.median(scatter[:: n // SAMPLED + 1]))) ** 2
        s = math.sqrt(s2 + float(hidden(s2, r)))
        t = -float(stdtrit(max(MAD_EFFICIENCY * n, 1.0), OUTLYING_P / (2 * n)))
        limit = max(max(GROSS, t) * s, least)
        near = np.flatnonzero(scatter > limit) + 1
        if s == 0 or not len(near):
            break
        deviation = np.zeros(len(x) + 4)  # two more at each end
        before2, before, mid, after, after2 = (
            np.pad(x, 2, constant_values=np.nan)[near + i] for i in range(5)
        )
        ways = (mid - 2 * before + before2, mid - 2 * after + after2, mid - (before + after) / 2,
                mid - (before2 + after2) / 2)  # fmt: skip
        deviation[near + 2] = np.nanmin(np.abs(ways), axis=0)
        deviation[deviation <= limit] = 0.0
        top = np.max([deviation[near + i] for i in range(5)], axis=0)
        worst = near[(deviation[near + 2] > 0) & (deviation[near + 2] == top)]
        if not len(worst):
            break
        result[rest[worst]] = True
    return result, s


ROTATIONS = 999
ENTRIES = 100_000
"""Tables with more entries are tested by bounds, single entries and means alone."""
DENSE_ROWS = 64
"""Up to so many rows the rotations are uniform on the whole orthogonal group."""

IN_CACHE = 250_000
"""Numbers rotated at a time: what stays in the processor's cache."""


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
    # Large tables: half of the error rate each to single entries and means, by the bound of
    # Bonferroni on Grubbs's statistic.
    entries = np.minimum(2 * d.size * deviation_p(d, count[None, :]), 1.0)
    means = d @ indicator
    scale = np.sqrt((means**2).sum(axis=0) / (len(d) - 1))
    means = means / np.where(scale > 0, scale, 1.0)
    mean = np.minimum(2 * means.size * deviation_p(means, np.full(1, float(len(d)))), 1.0)
    return Outstanding(by_row=mean.min(axis=1), by_cell=entries)


def _by_rotation(d: FloatArray, indicator: FloatArray, rng: np.random.Generator) -> Outstanding:
    observed = _statistics(d, indicator)
    # What is rotated: columns with missing entries, or that the last digit makes too small, are
    # stretched to the variance of the others.
    squares = np.einsum("ij,ij->j", d, d)
    filled = d * np.sqrt((len(d) - 1) / np.where(squares > 0, squares, np.inf))
    rotate = _rotations(filled, rng)
    square = len(d) ** 2 if len(d) <= DENSE_ROWS else 0
    batch = max(1, IN_CACHE // max(d.size, square, 1))
    maxima = [
        [kind.max(axis=1) for kind in _statistics(rotate(min(batch, ROTATIONS - start)), indicator)]
        for start in range(0, ROTATIONS, batch)
    ]
    largest = [np.concatenate(kind) for kind in zip(*maxima, strict=True)]
    # Entries are alike in all columns, the others differ in size from group to group.
    tests = [(observed[0], largest[0].max(axis=1)), *map(_alike, observed[1:], largest[1:])]
    # The three kinds are tested side by side: the smallest p of a table under the null is
    # itself referred to its distribution.
    smallest = np.min([_tail(null, null) for _, null in tests], axis=0)
    # Of a p value the small ones stand out: the tail of their negatives.
    entries, distance, mean = (_tail(-_tail(*test), -smallest) for test in tests)
    by_row = np.minimum(distance.min(axis=1), mean.min(axis=1))
    return Outstanding(by_row=by_row, by_cell=entries)


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


def _rotations(d: FloatArray, rng: np.random.Generator) -> Callable[[int], FloatArray]:
    """So many random rotations (n, rows, columns) of the centred table `d`, means of columns 0."""
    rows = len(d)
    if rows > DENSE_ROWS:
        from scipy.fft import dct, idct

        core = dct(d, axis=0, norm="ortho")
        signs = np.array([-1, 1], d.dtype)

        def flip(n: int) -> FloatArray:
            turned = core * rng.choice(signs, (n, rows, 1))
            threads = available_threads()
            return idct(turned, axis=1, norm="ortho", overwrite_x=True, workers=threads)

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
